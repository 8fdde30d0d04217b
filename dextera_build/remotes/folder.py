"""A folder as a remote: a network share, or another store, in the layout of a store.

Files are written under temporary names and renamed, so no locks are needed: even on NFS, a reader sees all of a file or
none.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from dextera_build.errors import StoreError
from dextera_build.remotes.remote import Digest, Kind, Remote, RemoteFault, T
from dextera_build.store import failpoints, files

_CHUNK = 1 << 20
_ABSENT = (FileNotFoundError, IsADirectoryError)
"""A folder in the place of a file is damage; the next upload replaces it."""
_ABANDONED_S = 86400.0
"""Age from which an unfinished file counts as left by a killed process [s]."""


def opened(address: str, options: Mapping[str, str], timeout_s: float) -> Remote:
    """Open a folder, as `schemes.opened`."""
    return Directory(Path(os.path.expanduser(address.removeprefix("file://"))).absolute())


class Directory(Remote):
    """Blobs under `cas/ab/cdef...` and results under `ac/ab/cdef...` of one folder.

    Args:
        root: The folder; created by the first write if its parent exists.
    """

    def __init__(self, root: Path) -> None:
        self.address = str(root)
        self._root = root
        self._tidied = False

    def has(self, digest: Digest) -> bool:
        """As `Remote`."""
        try:
            state = os.stat(self._file("cas", digest.hash))
        except _ABSENT:
            return False
        except OSError as error:
            raise self._fault(error) from None
        return state.st_size == digest.size and stat.S_ISREG(state.st_mode)

    def _get(self, kind: Kind, name: str, take: Callable[[Iterator[bytes]], T]) -> T | None:
        try:
            file = open(self._file(kind, name), "rb")  # noqa: SIM115 - closed below; only opening may find nothing
        except _ABSENT:
            return None
        except OSError as error:
            raise self._fault(error) from None
        with file:
            return take(self._pieces(file))

    def _put(self, kind: Kind, digest: Digest, file: BinaryIO) -> None:
        with self._writing(kind, digest.hash) as target, open(target, "wb", closefd=False) as to:
            if kind == "cas":
                failpoints.reach("remote.blob")
            else:
                failpoints.reach("remote.entry")
            shutil.copyfileobj(file, to, _CHUNK)

    def _pieces(self, file: BinaryIO) -> Iterator[bytes]:
        try:
            while piece := file.read(_CHUNK):
                yield piece
        except OSError as error:
            raise self._fault(error) from None

    def _file(self, kind: str, digest: str) -> str:
        return f"{self._root}/{kind}/{digest[:2]}/{digest[2:]}"

    @contextmanager
    def _writing(self, kind: str, digest: str) -> Iterator[int]:
        if not self._root.parent.is_dir():
            raise RemoteFault(self.address, f"there is no folder `{self._root.parent}`", refused=True)
        workshop = f"{self._root}/{kind}/{files.TEMPORARY}"
        if not self._tidied:
            self._tidied = True
            for each in ("cas", "ac"):
                files.clear(f"{self._root}/{each}/{files.TEMPORARY}", _ABANDONED_S)
        try:
            with files.new_file(self._file(kind, digest), workshop=workshop) as target:
                yield target
        except StoreError as error:
            system = error.facts.get("system says", error.message)
            raise RemoteFault(self.address, f"nothing can be written there: {system}", refused=True) from None
        except OSError as error:
            raise self._fault(error) from None

    def _fault(self, error: OSError) -> RemoteFault:
        return RemoteFault(self.address, error.strerror or str(error), refused=isinstance(error, PermissionError))
