"""One builder per key: advisory locks on single bytes of one file, at an offset derived from the key's digest.

A lock vanishes with the process that holds it, so a killed build never blocks the next one, and there are no lock files
to clean up. A build that waited for a lock checks the cache again before building.
"""

from __future__ import annotations

import errno
import fcntl
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dextera_build.store import failpoints, permissions

_PROBE = 1 << 61
"""An offset that no key has."""

_NONE = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}
"""Error numbers of systems on which a file system has no locks."""

_MOST_OPEN = 64
"""Number of open lock files from which unlocked ones are closed."""

# POSIX locks belong to the process and are all dropped when any descriptor of the file is closed, so each file is
# opened once per process and stays open while a lock is held; `_held` excludes threads from one another.
_guard = threading.RLock()
_open: dict[str, int] = {}
_held: set[tuple[int, int]] = set()


class Locks:
    """Locks of one store.

    Args:
        path: The lock file, which stays empty.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._name = str(path)

    def take(self, key: str) -> bool:
        """Take the lock of `key`, or return False if another thread or process holds it.

        A read-only store or a file system without locks grants every lock: nothing can be published there twice
        anyway.
        """
        with _guard:
            descriptor = self._descriptor()
            if descriptor < 0:
                return True
            place = (descriptor, _offset(key))
            if place in _held:
                return False
            try:
                fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place[1])
            except (BlockingIOError, PermissionError):
                return False
            except OSError:
                return True
            _held.add(place)
        failpoints.reach("lock.taken")
        return True

    def release(self, key: str) -> None:
        """Release the lock of `key`; do nothing if it is not held."""
        with _guard:
            place = (self._descriptor(), _offset(key))
            if place in _held:
                _held.discard(place)
                with suppress(OSError):
                    fcntl.lockf(place[0], fcntl.LOCK_UN, 1, place[1])

    def is_held_elsewhere(self, key: str) -> bool:
        """Whether another thread or process holds the lock of `key`; False if locks do not work."""
        if not self.take(key):
            return True
        self.release(key)
        return False

    def reliable(self) -> bool:
        """Whether the file system has locks and this process may take them."""
        return self._refused() is None

    def are_missing(self) -> bool:
        """Whether the file system has no locks, as NFS without its lock daemon."""
        return self._refused() in _NONE

    def _refused(self) -> int | None:
        """Why the system refuses a lock (`errno`); None if it gives one."""
        with _guard:
            descriptor = self._descriptor()
            if descriptor < 0:
                return errno.EACCES
            try:
                fcntl.lockf(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB, 1, _PROBE)
                fcntl.lockf(descriptor, fcntl.LOCK_UN, 1, _PROBE)
            except OSError as error:
                return error.errno
        return None

    @contextmanager
    def hold(self, key: str, patience_s: float = 0.02) -> Iterator[None]:
        """Wait for the lock of `key`, polling every `patience_s` [s], and hold it for the block."""
        while not self.take(key):
            time.sleep(patience_s)
        try:
            yield
        finally:
            self.release(key)

    def _descriptor(self) -> int:
        """The open lock file, or -1 if it cannot be opened; valid while the caller holds the guard."""
        known = _open.get(self._name)
        if known is not None:
            return known
        _close_idle()
        try:
            permissions.make_folder(str(self._path.parent))
            _open[self._name] = os.open(self._name, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            failpoints.reach("lock.made")
            permissions.share_file(_open[self._name], str(self._path.parent), 0o644)
        except OSError:
            return -1
        return _open[self._name]


def _close_idle() -> None:
    """Close unlocked files if many are open: a program may use any number of stores."""
    if len(_open) < _MOST_OPEN:
        return
    busy = {descriptor for descriptor, _ in _held}
    for name, descriptor in list(_open.items()):
        if descriptor not in busy:
            os.close(_open.pop(name))


def _offset(key: str) -> int:
    return int(key[:15], 16)
