"""The store: digest -> bytes, key -> result, and local state of this machine."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import files
from dextera_build.store.blobs import Blobs, MissingBlob, listing
from dextera_build.store.divergent import Divergent
from dextera_build.store.locks import Locks
from dextera_build.store.progress import Keep
from dextera_build.store.results import Actions
from dextera_build.store.running import Running
from dextera_build.store.statcache import StatCache
from dextera_build.store.state import State

_TAG = b"""Signature: 8a477f597d28d172789f06886806bc55
# This file marks a cache: backup programs leave it out.
# See https://bford.info/cachedir/
"""


class Reader:
    """Reads the blobs of a store for decoding artifacts; see `artifacts.content`."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.place = blobs.place

    def __call__(self, digest: str) -> bytes:
        """The bytes of a blob; see `Blobs.get`."""
        return self._blobs.get(digest)

    def path(self, digest: str) -> Path:
        """The file of a blob, after verifying its digest; the file is read-only.

        Raises:
            MissingBlob: It does not exist, or is damaged and was moved to quarantine.
        """
        if not self._blobs.verify(digest):
            raise MissingBlob(digest)
        return self._blobs.path(digest)


class Writer:
    """Writes the blobs of encoded artifacts to a store; see `artifacts.content`."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.file, self.has, self.view = blobs.put_file, blobs.holds, blobs.put

    def __call__(self, data: bytes) -> str:
        """Store bytes; see `Blobs.put`."""
        return self._blobs.put(data)


class Store:
    """One folder that builds share.

        cas/ab/cdef...   blobs, read-only, by SHA-256
        ac/ab/cdef...    results by key, JSON
        runs/0001/       event logs
        local/           state of this machine: signatures of project files, history, snapshots and divergent keys
                         (`state.db`), locks, running builds, damaged blobs in quarantine, saved progress of unfinished
                         calls

    Args:
        root: The folder; created if it is missing.
        make: False if the store is only read: a missing folder is not created and counts as empty, and a plan's writes
            to a read-only store stay in memory.

    Raises:
        StoreError: The folder is missing and cannot be created.
    """

    def __init__(self, root: Path, *, make: bool = True) -> None:
        self.root = root.absolute()
        self.local = self.root / "local"
        if make:
            self._prepare()
        takes = make or self._may_be_written()
        self.blobs = Blobs(self.root / "cas", takes=takes)
        self.actions = Actions(self.root / "ac", self.blobs)
        self.state = State(str(self.local / "state.db"), takes=takes)
        self.leaves = StatCache(self.blobs, self.state)
        self.locks = Locks(self.local / "locks")
        self.keep = Keep(self.local / "keep")
        self.divergent = Divergent(self.state)
        self.reader, self.writer = Reader(self.blobs), Writer(self.blobs)
        self.running = Running(self.local / "running", self.locks)

    def size(self) -> dict[str, tuple[int, int]]:
        """(count, bytes) of `blobs`, `actions` and `keep`, the saved progress of unfinished calls."""
        found = {"blobs": listing(self.blobs.root), "actions": listing(self.actions.root), "keep": self.keep.all()}
        sizes = {name: [size for _, size, _ in each] for name, each in found.items()}
        return {name: (len(each), sum(each)) for name, each in sizes.items()}

    def _may_be_written(self) -> bool:
        folder = self.root / "cas"
        return os.access(folder if folder.is_dir() else self.root, os.W_OK)

    def _prepare(self) -> None:
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise files.store_error(error, str(self.root)) from None
        tag = self.root / "CACHEDIR.TAG"
        if not tag.exists():
            # A read-only store still serves its contents.
            with suppress(StoreError):
                files.write(str(tag), _TAG, 0o644)


@lru_cache(maxsize=1)
def opened(root: str) -> Store:
    """Open a store, and keep it for a process that uses a single one; see `Store`."""
    return Store(Path(root))
