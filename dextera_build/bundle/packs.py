"""Assigns blobs to layers: small ones to archives of bounded size, each large one to a layer of its own.

An archive holds the blobs whose digests begin with the same bits, so a blob that is added, or gone, changes the one
archive that it belongs to and no other: a registry that has the last bundle takes little of the next.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from dextera_build.bundle import tar
from dextera_build.bundle.oci import BLOB, PACK, TITLE, Descriptor

LARGE = 16 << 20
"""Smallest blob that gets a layer of its own [bytes], unless that would make too many layers."""
_MANY = 1000
_FOLDER = "cas/"

Open = Callable[[str], Iterator[bytes]]
"""digest -> the blob's bytes in pieces, checked."""


@dataclass(frozen=True)
class Layer:
    """The blobs of one layer, in order."""

    blobs: tuple[tuple[str, int], ...]
    """(digest, size)."""
    alone: bool

    def chunks(self, read: Open) -> Iterator[bytes]:
        """The layer's bytes."""
        if self.alone:
            yield from read(self.blobs[0][0])
            return
        for digest, size in self.blobs:
            yield tar.header(_FOLDER + digest, size)
            yield from read(digest)
            yield tar.padding(size)
        yield tar.END

    def describe(self, read: Open, number: int) -> Descriptor:
        """The descriptor; reads an archive once for its digest."""
        if self.alone:
            digest, size = self.blobs[0]
            return Descriptor(BLOB, digest, size, annotations={TITLE: _FOLDER + digest})
        state = hashlib.sha256()
        for chunk in self.chunks(read):
            state.update(chunk)
        size = sum(tar.BLOCK + size + len(tar.padding(size)) for _, size in self.blobs) + len(tar.END)
        return Descriptor(PACK, state.hexdigest(), size, annotations={TITLE: f"blobs-{number:04d}.tar"})


def layers(sizes: Mapping[str, int], large: int = LARGE) -> list[Layer]:
    """Layers for these blobs (digest -> size); the same blobs give the same layers.

    Args:
        sizes: What is to be held.
        large: The least size of a blob that is a layer of its own; grows with the total, so that there are never more
            than some thousand layers.
    """
    large = max(large, sum(sizes.values()) // _MANY)
    small = sorted((digest, size) for digest, size in sizes.items() if size < large)
    alone = sorted((digest, size) for digest, size in sizes.items() if size >= large)
    return [
        *(Layer(tuple(pack), False) for pack in _packs(small, 4 * large)),
        *(Layer((blob,), True) for blob in alone),
    ]


def _packs(blobs: list[tuple[str, int]], most: int) -> Iterator[list[tuple[str, int]]]:
    """Split sorted blobs by the bits of their digests until no part exceeds `most` bytes or the files of an archive."""
    stack = [(blobs, 255)] if blobs else []
    while stack:
        part, bit = stack.pop()
        fits = len(part) <= tar.MOST_FILES and sum(size + 2 * tar.BLOCK for _, size in part) <= most
        if fits or len(part) == 1:
            yield part
            continue
        ones = [blob for blob in part if int(blob[0], 16) >> bit & 1]
        zeros = [blob for blob in part if not int(blob[0], 16) >> bit & 1]
        stack += [(half, bit - 1) for half in (ones, zeros) if half]
