"""Bytes that are read on demand: a file on disk, or a blob of the store.

A `put` or `get` function may have further methods: `put.file(path)` stores a file without reading it whole,
`put.view(memoryview)` stores bytes that may change later, `put.has(digest, size)` returns whether a blob is already
stored, `get.path(digest)` returns a file with the bytes of a blob, and `get.place(digest, target)` writes them. Plain
functions, as in tests of rules, pass bytes.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

Put = Callable[[bytes], str]
Get = Callable[[str], bytes]

SMALL = 1 << 20
"""Blobs up to this size [bytes] are read at once."""


class Content(Protocol):
    """Bytes that can be read, placed or stored."""

    def path(self) -> Path:
        """A file with these bytes, not to be written to."""
        ...

    def read(self) -> bytes:
        """All bytes."""
        ...

    def length(self) -> int:
        """Number of bytes."""
        ...

    def place(self, target: Path) -> None:
        """Write them to `target`, which belongs to the caller."""
        ...

    def store(self, put: Put) -> tuple[str, int]:
        """Store them and return (digest, size)."""
        ...


@dataclass(frozen=True)
class OnDisk:
    """The bytes of a file that must no longer change."""

    file: Path

    def path(self) -> Path:
        """The file itself."""
        return self.file

    def read(self) -> bytes:
        """All of it."""
        return self.file.read_bytes()

    def length(self) -> int:
        """Size of the file."""
        return self.file.stat().st_size

    def place(self, target: Path) -> None:
        """Copy it."""
        shutil.copyfile(self.file, target)

    def store(self, put: Put) -> tuple[str, int]:
        """Store it in pieces, if `put` supports it."""
        stream = getattr(put, "file", None)
        if stream is None:
            data = self.read()
            return put(data), len(data)
        digest, size = stream(self.file)
        return str(digest), int(size)


@dataclass(frozen=True)
class Stored:
    """A blob behind a `get` that has `path` and `place`."""

    get: Any
    digest: str
    size: int

    def path(self) -> Path:
        """The file of the blob, after a check of its digest."""
        found: Path = self.get.path(self.digest)
        return found

    def read(self) -> bytes:
        """All of it."""
        data: bytes = self.get(self.digest)
        return data

    def length(self) -> int:
        """Size of the blob."""
        return self.size

    def place(self, target: Path) -> None:
        """Copy it, sharing its blocks if the file system can."""
        self.get.place(self.digest, target)

    def store(self, put: Put) -> tuple[str, int]:
        """Store it, unless it is stored already."""
        has = getattr(put, "has", None)
        if has is not None and has(self.digest, self.size):
            return self.digest, self.size
        return OnDisk(self.path()).store(put)
