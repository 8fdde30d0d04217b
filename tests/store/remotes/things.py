"""Blobs to send, and a store of them to compare with."""

from __future__ import annotations

import hashlib
import io
import random
import threading
from collections.abc import Iterator
from typing import BinaryIO

from dextera_build.store.remotes.remote import Digest


def digest_of(data: bytes) -> Digest:
    """What names these bytes."""
    return Digest(hashlib.sha256(data).hexdigest(), len(data))


def blob(size: int, seed: int = 0) -> bytes:
    """Bytes that compress badly and differ by seed."""
    return random.Random(size * 7919 + seed).randbytes(size)


class Blobs(dict[Digest, bytes]):
    """Blobs by digest, and both ends that a remote needs of them."""

    def __init__(self, *contents: bytes) -> None:
        super().__init__((digest_of(data), data) for data in contents)
        self.opened = 0
        self._guard = threading.Lock()

    def give(self, digest: Digest) -> BinaryIO:
        """Open a blob."""
        self.opened += 1
        return io.BytesIO(self[digest])

    def take(self, digest: Digest, pieces: Iterator[bytes]) -> None:
        """Keep a blob."""
        data = b"".join(pieces)
        with self._guard:
            assert digest not in self, "a blob came twice"
            self[digest] = data
