"""The bytes of a descriptor, checked as they pass: no more than its size, and with its digest."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from dextera_build.store.bundle.errors import damaged, too_large
from dextera_build.store.bundle.layout import Layout
from dextera_build.store.bundle.oci import Descriptor


def stream(source: Layout, wanted: Descriptor, what: str = "a layer") -> Iterator[bytes]:
    """The bytes of a descriptor, in pieces; the last one is followed by the check of all.

    Raises:
        BundleRefused: They are not those that the descriptor names.
    """
    state, size = hashlib.sha256(), 0
    for chunk in source.chunks(wanted):
        size += len(chunk)
        if size > wanted.size:
            raise damaged(what, wanted.digest, f"has more than its {wanted.size} bytes")
        state.update(chunk)
        yield chunk
    if size != wanted.size:
        raise damaged(what, wanted.digest, f"has {size} of its {wanted.size} bytes")
    if state.hexdigest() != wanted.digest:
        raise damaged(what, wanted.digest, "has other bytes")


def whole(source: Layout, wanted: Descriptor, what: str, most: int) -> bytes:
    """All bytes of a small document.

    Raises:
        BundleRefused: It is larger than `most` bytes, or not what the descriptor names.
    """
    if wanted.size > most:
        raise too_large(what, wanted.size, most)
    return b"".join(stream(source, wanted, what))
