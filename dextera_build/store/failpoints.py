"""Named points before and after changes on disk, at which tests can stop a process.

    DXB_FAILPOINT=result.blobs:kill         the process is killed (SIGKILL) when it first reaches `result.blobs`
    DXB_FAILPOINT=file.written:error:7      at the seventh hit, the system call fails

The variable is read once; without it, a failpoint costs one call of an empty function. Names that are not in `POINTS`
are never reached.
"""

from __future__ import annotations

import errno
import os
import signal
from collections.abc import Callable
from typing import NamedTuple

VARIABLE = "DXB_FAILPOINT"
ERRORS = {"error": errno.EIO, "full": errno.ENOSPC}
"""System errors that can be injected at failpoints before system calls."""
KILLS = {"kill": signal.SIGKILL, "interrupt": signal.SIGINT}


class Point(NamedTuple):
    """One failpoint."""

    when: str
    """The state of the disk at this point."""
    fails: bool = False
    """Whether a system call follows, so that `ERRORS` can be injected."""


POINTS = {
    "folder.made": Point("a folder of the store was made, those below it not yet", fails=True),
    "folder.aside": Point("a folder of a shared store was made under another name", fails=True),
    "file.made": Point("an unfinished file is there, empty", fails=True),
    "file.written": Point("an unfinished file holds all its bytes", fails=True),
    "file.moved": Point("a file was renamed into place"),
    "blob.aside": Point("a blob was found damaged, and is still in its place", fails=True),
    "result.blobs": Point("all blobs of a result are there, its entry is not"),
    "result.published": Point("a result was published but not yet reported"),
    "result.damaged": Point("an entry was found damaged, and is still in its place", fails=True),
    "result.diverged": Point("a key gave another output, and that was written down"),
    "use.noted": Point("a blob or an entry is to be marked as used", fails=True),
    "leaves.save": Point("the table of signatures is to be written"),
    "snapshot.saved": Point("a snapshot is whole"),
    "history.saved": Point("the history was written; the notes beside the old one still exist"),
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
    "export.cleared": Point("the old files of a target are removed, the new ones not yet placed", fails=True),
    "export.written": Point("a target's files are written, maybe not on the disk", fails=True),
    "export.stamp": Point("a target's files are on the disk, their stamp is not"),
    "place.copied": Point("a blob was copied to a temporary name", fails=True),
    "pins.write": Point("dxb.lock is to be written"),
    "remote.blob": Point("a blob is to be written to a remote folder", fails=True),
    "remote.entry": Point("all blobs of a result are in a remote folder, its entry is not", fails=True),
    "fetch.blobs": Point("all blobs of a remote result are here, its entry is not"),
    "import.blobs": Point("all blobs of a bundle are in the store, its results are not"),
}


def arm(wish: str) -> None:
    """Arm a failpoint, spelled as in `DXB_FAILPOINT`; "" disarms the last one."""
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
"""Called at each failpoint."""
arm(os.environ.get(VARIABLE, ""))
