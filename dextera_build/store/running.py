"""Announcements of running builds, which keep collections from removing anything that they need.

An announcement is a small file, whose time stamp is the start of the build, and a lock that vanishes with the process.
A collection that finds no announcement keeps the lock `_ALONE`, and builds that start meanwhile wait until it ends.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files
from dextera_build.store.locks import Locks

_ALONE = digests.of_bytes(b"a collection that no build may disturb")
_ONE = digests.of_bytes(b"one collection at a time")
_PATIENCE_S = 0.01
_FORGOTTEN_S = 7 * 86400.0
"""Age from which an announcement counts as dead if locks do not work [s]."""


class Running:
    """The running builds of one store.

    Args:
        folder: Folder of the announcements.
        locks: Show whether the process of an announcement is alive.
    """

    def __init__(self, folder: Path, locks: Locks) -> None:
        self._folder = folder
        self._locks = locks

    @contextmanager
    def announced(self) -> Iterator[None]:
        """Announce a running build for the block, after waiting for a collection that has exclusive access.

        A read-only store gets no announcement, and its builds are not protected.
        """
        name = files.unique()
        path, lock = str(self._folder / name), _lock(name)
        self._locks.take(lock)
        try:
            # Not read-only like a blob: a collection may have to remove it.
            with suppress(StoreError):
                files.write(path, f"process {os.getpid()} on {os.uname().nodename}\n".encode(), 0o644)
            failpoints.reach("running.announced")
            while self._locks.is_held_elsewhere(_ALONE):
                time.sleep(_PATIENCE_S)
            yield
        finally:
            with suppress(OSError):
                failpoints.reach("running.ended")
                os.unlink(path)
            self._locks.release(lock)

    def starts(self) -> list[float]:
        """Start times of the running builds (seconds since the epoch); announcements of dead builds are removed."""
        found = []
        # A link leads to files that are no announcements, whose locks no process holds.
        for path in () if self._folder.is_symlink() else self._folder.glob("[!.]*"):
            with suppress(OSError):
                began = path.lstat().st_mtime
                if self._is_dead(path.name, began):
                    failpoints.reach("running.forgotten")
                    path.unlink()
                else:
                    found.append(began)
        return sorted(found)

    @contextmanager
    def collecting(self) -> Iterator[bool]:
        """Be the only collection for the block; yield True if no build runs and none can start before it ends."""
        with self._locks.hold(_ONE), self._locks.hold(_ALONE):
            alone = self._locks.reliable() and not self.starts()
            if not alone:
                self._locks.release(_ALONE)
            yield alone

    def _is_dead(self, name: str, began: float) -> bool:
        if not self._locks.reliable():
            return began < time.time() - _FORGOTTEN_S
        if not self._locks.take(_lock(name)):
            return False
        self._locks.release(_lock(name))
        return True


def _lock(name: str) -> str:
    return digests.of_bytes(f"build {name}".encode())
