"""Bytes from a source, checked as they pass: not more than was said, and with the digest that was said."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from dextera_build.store.bundle import oci
from dextera_build.store.bundle.oci import Descriptor, Manifest, Sink, Source
from dextera_build.store.bundle.refusal import damaged, too_large


def stream(source: Source, wanted: Descriptor, what: str = "a layer") -> Iterator[bytes]:
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


def whole(source: Source, wanted: Descriptor, what: str, most: int) -> bytes:
    """All bytes of a small document.

    Raises:
        BundleRefused: It is larger than `most` bytes, or not what the descriptor names.
    """
    if wanted.size > most:
        raise too_large(what, wanted.size, most)
    return b"".join(stream(source, wanted, what))


def copy(source: Source, sink: Sink) -> list[Descriptor]:
    """Copy a bundle and what is said of it, piece by piece, and return its manifests."""
    found = source.manifests()
    for descriptor in found:
        data = whole(source, descriptor, "the manifest", oci.MOST_MANIFEST)
        for part in Manifest.read(data).parts():
            if not sink.has(part):
                sink.write(part, stream(source, part))
        sink.manifest(descriptor, data)
    return found
