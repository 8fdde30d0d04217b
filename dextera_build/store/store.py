"""The store: digest -> bytes, key -> result, and what this machine remembers."""

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
    """The blobs of a store as artifacts are decoded from them; see `artifacts.content`."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.place = blobs.place

    def __call__(self, digest: str) -> bytes:
        """The bytes of a blob; see `Blobs.get`."""
        return self._blobs.get(digest)

    def path(self, digest: str) -> Path:
        """The file of a blob whose bytes were compared with its digest; it may only be read.

        Raises:
            MissingBlob: It is not there, or is damaged; then it was set aside.
        """
        if not self._blobs.verify(digest):
            raise MissingBlob(digest)
        return self._blobs.path(digest)


class Writer:
    """The blobs of a store as artifacts are encoded into them; see `artifacts.content`."""

    def __init__(self, blobs: Blobs) -> None:
        self._blobs = blobs
        self.file, self.has = blobs.put_file, blobs.holds

    def __call__(self, data: bytes) -> str:
        """Store bytes; see `Blobs.put`."""
        return self._blobs.put(data)


class Store:
    """One folder that builds share.

        cas/ab/cdef...   blobs, read-only, by SHA-256
        ac/ab/cdef...    results by key, JSON
        runs/0001/       event logs
        local/           what belongs to this machine: signatures of project files, history, snapshots and keys that
                         gave more than one output (`state.db`), locks, builds that run now, damaged blobs that were
                         set aside, what calls that did not end keep for their next try

    Args:
        root: The folder; made when it is not there.
        make: False where it is only read: then none is made, one that is not there is empty, and what a plan puts into
            one that cannot be written is held in memory.

    Raises:
        StoreError: The folder is not there and cannot be made.
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
        """(count, bytes) of `blobs`, `actions` and `keep`, the saved progress of calls that did not end."""
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
            # A store that can only be read still serves what it holds.
            with suppress(StoreError):
                files.write(str(tag), _TAG, 0o644)


@lru_cache(maxsize=1)
def opened(root: str) -> Store:
    """The store of a process that serves one; see `Store`."""
    return Store(Path(root))
