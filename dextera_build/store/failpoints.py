"""Named moments at which what is on disk has just changed or is about to, so that tests can stop a process at each.

    DXB_FAILPOINT=result.blobs:kill         the process is killed (SIGKILL) when it first comes to `result.blobs`
    DXB_FAILPOINT=file.written:error:7      the seventh time that it comes there, the system reports a fault

Without the variable, which is read once, coming to a failpoint is one call of a function that does nothing. A name that
is not in `POINTS` is never come to.
"""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable
from typing import NamedTuple

VARIABLE = "DXB_FAILPOINT"
ERRORS = {"error": errno.EIO, "full": errno.ENOSPC}
"""What the system can be made to answer, at failpoints that stand before one of its calls."""
KILLS = {"kill": signal.SIGKILL, "interrupt": signal.SIGINT}


class Point(NamedTuple):
    """One failpoint."""

    when: str
    """What is on disk at that moment."""
    fails: bool = False
    """Whether the system may refuse what comes next, so that `ERRORS` can happen there."""


POINTS = {
    "folder.made": Point("a folder of the store was made, those below it not yet", fails=True),
    "folder.aside": Point("a folder of a shared store was made under another name", fails=True),
    "file.made": Point("an unfinished file is there, empty", fails=True),
    "file.written": Point("an unfinished file holds all its bytes", fails=True),
    "file.moved": Point("a file came under its name"),
    "blob.aside": Point("a blob was found damaged, and is still in its place", fails=True),
    "result.blobs": Point("all blobs of a result are there, its entry is not"),
    "result.published": Point("a result was published, and nobody was told"),
    "result.damaged": Point("an entry was found damaged, and is still in its place", fails=True),
    "result.diverged": Point("a key gave another output, and that was written down"),
    "use.noted": Point("a blob or an entry is to be marked as used", fails=True),
    "leaves.save": Point("the table of signatures is to be written"),
    "snapshot.saved": Point("a snapshot is whole"),
    "history.saved": Point("the history was written; what was noted beside the old one is still there"),
    "keep.aside": Point("a folder that a call kept has no name any more, and is still there", fails=True),
    "log.made": Point("the folder of a run was made, its log was not", fails=True),
    "log.event": Point("an event of a run is to be written", fails=True),
    "lock.made": Point("the lock file was made", fails=True),
    "lock.taken": Point("a lock was taken"),
    "running.announced": Point("a build announced itself"),
    "running.ended": Point("a build is over, its announcement is still there", fails=True),
    "running.forgotten": Point("the announcement of a dead build was found", fails=True),
    "collect.file": Point("a collection is to remove a file, and holds its gate", fails=True),
    "collect.results": Point("a collection removed results, and no blob of theirs"),
    "collect.blobs": Point("a collection removed blobs, and no leftovers"),
    "collect.log": Point("a collection is to remove the log of an old run", fails=True),
    "repair.found": Point("damage was found, and is to be removed", fails=True),
    "export.cleared": Point("what a target was is gone, what it is now is not there", fails=True),
    "export.written": Point("a target's files are written, maybe not on the disk", fails=True),
    "export.stamp": Point("a target's files are on the disk, the stamp that says so is not there"),
    "place.copied": Point("a blob was copied beside its place", fails=True),
    "pins.write": Point("dxb.lock is to be written"),
    "remote.blob": Point("a blob is to be written to a remote folder", fails=True),
    "remote.entry": Point("all blobs of a result are in a remote folder, its entry is not", fails=True),
    "fetch.blobs": Point("all blobs of a remote result are here, its entry is not"),
    "import.blobs": Point("all blobs of a bundle are in the store, its results are not"),
}


def arm(wish: str) -> None:
    """Take a wish as `DXB_FAILPOINT` has it; "" takes the last one back."""
    global reach
    reach = _Armed(*wish.split(":")) if wish else _pass


class _Armed:
    def __init__(self, name: str, does: str = "kill", count: str = "1") -> None:
        self._name = name
        self._does = does
        self._left = int(count) if count.isdigit() else 1

    def __call__(self, name: str) -> None:
        if name != self._name:
            return
        self._left -= 1
        if self._left != 0:
            return
        if self._does in ERRORS:
            raise OSError(ERRORS[self._does], f"{os.strerror(ERRORS[self._does])} (failpoint {name})")
        os.kill(os.getpid(), KILLS.get(self._does, signal.SIGKILL))


def _pass(name: str) -> None:
    pass


reach: Callable[[str], None] = _pass
"""Be at a failpoint."""
arm(os.environ.get(VARIABLE, ""))
