"""When blobs and results were of use last: their modification time, renewed at most once an hour.

The promise to builds rests on it. A build that finds a blob or a result relies on it only when its stamp is younger
than `STEP_S`, or when it could renew the stamp; a collection removes a file only when its stamp is older than `STEP_S`
before the oldest running build began. Both look and act under one lock (a gate) per folder of the store, so that one
comes first: either the collection sees the new stamp and spares the file, or the build sees that the file is gone.
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
"""A stamp is renewed when it is older than this [s]."""
SLACK_S = 60.0
"""What clocks of machines and steps of file systems may differ by [s]."""
_PATIENCE_S = 0.0005


class Use:
    """Last uses of the files of one store.

    Args:
        locks: Hold the gates.
    """

    def __init__(self, locks: Locks) -> None:
        self._locks = locks

    def note(self, path: str, stamp: float) -> bool:
        """Whether a build that found `path`, last used at `stamp`, may rely on it until it ends.

        A store that cannot be written is relied on all the same: there is no way to ask anyone for anything.

        Raises:
            PermissionError: The file is another user's; it must be written again.
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
        """Whether a use at `stamp` (seconds since the epoch) need not be noted again."""
        return stamp > time.time() - STEP_S

    def drop(self, path: str, older_than: float) -> bool:
        """Remove `path` if it was last used before `older_than` (seconds since the epoch); whether it is gone.

        What the system does not let go of stays.
        """
        with self.gate(path):
            try:
                if os.stat(path).st_mtime >= older_than:
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
        """Keep everyone else from noting and dropping files of the folder of `path`."""
        # By the last two folders, since machines may mount one store at different places.
        place = "/".join(os.path.dirname(path).split(os.sep)[-2:])
        with self._locks.hold(digests.of_bytes(f"gate {place}".encode()), _PATIENCE_S):
            yield
