"""Last use of blobs and results: their modification time, renewed at most once an hour.

This protects running builds from collections. A build relies on a blob or a result only if its stamp is younger than
`STEP_S` or could be renewed; a collection removes a file only if its stamp is older than `STEP_S` before the start of
the oldest running build. Both check and act under one lock (a gate) per folder of the store: either the collection sees
the new stamp and spares the file, or the build sees that the file is gone.
"""

from __future__ import annotations

import errno
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager

from dextera_build import digest as digests
from dextera_build.store import failpoints
from dextera_build.store.locks import Locks

STEP_S = 3600.0
"""Age from which a stamp is renewed [s]."""
SLACK_S = 60.0
"""Tolerance for clock differences between machines and time stamp steps of file systems [s]."""
_PATIENCE_S = 0.0005


class Use:
    """Last uses of the files of one store.

    Args:
        locks: Provides the gates.
    """

    def __init__(self, locks: Locks) -> None:
        self._locks = locks

    def note(self, path: str, stamp: float) -> bool:
        """Renew the stamp of `path`, last used at `stamp`; return whether a build may rely on it until it ends.

        Files of a read-only store are always relied on, since their stamps cannot be renewed.

        Raises:
            PermissionError: Another user owns the file; it must be written again.
        """
        if self.is_recent(stamp):
            return True
        with self.gate(path):
            try:
                failpoints.reach("use.noted")
                os.utime(path)
            except OSError as error:
                if error.errno in (errno.EACCES, errno.EPERM) and os.access(os.path.dirname(path), os.W_OK):
                    raise PermissionError(error.errno, error.strerror, path) from None
                return error.errno not in (errno.ENOENT, errno.ENOTDIR)
        return True

    def is_recent(self, stamp: float) -> bool:
        """Whether `stamp` (seconds since the epoch) is too recent to need renewal."""
        return stamp > time.time() - STEP_S

    def drop(self, path: str, older_than: float) -> bool:
        """Remove `path` if it was last used before `older_than` (seconds since the epoch); return whether it is gone.

        Files that cannot be removed stay.
        """
        with self.gate(path):
            try:
                if os.lstat(path).st_mtime >= older_than:
                    return False
                failpoints.reach("collect.file")
                os.unlink(path)
            except FileNotFoundError:
                pass
            except IsADirectoryError:  # damage
                shutil.rmtree(path, ignore_errors=True)
                return not os.path.exists(path)
            except OSError:
                return False
        return True

    @contextmanager
    def gate(self, path: str) -> Iterator[None]:
        """Exclude other threads and processes from noting and dropping files in the folder of `path`."""
        # Named by the last two folders, since machines may mount a store at different paths.
        place = "/".join(os.path.dirname(path).split(os.sep)[-2:])
        with self._locks.hold(digests.of_bytes(f"gate {place}".encode()), _PATIENCE_S):
            yield
