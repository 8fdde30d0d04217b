"""Writes bundles of results in a store. Blobs are streamed, never held in memory."""

from __future__ import annotations

import hashlib
import os
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.bundle import closure, layout, oci
from dextera_build.bundle.config import Contents
from dextera_build.bundle.oci import Descriptor, Manifest
from dextera_build.errors import UsageError
from dextera_build.store import files
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

_CHUNK = 1 << 20
_PACK = 64 << 20
"""Most bytes of one archive of blobs, unless that would make too many archives."""
_MANY = 128


class Export:
    """The bundle of some nodes of a store.

    Args:
        store: Holds everything that the nodes need.
        contents: The nodes.
        created: When the results were made, as RFC 3339; "" if unknown.

    Raises:
        MissingBlob: The store lacks a blob, or a blob is damaged.
        BundleRefused: A document in the store is malformed.
    """

    def __init__(self, store: Store, contents: Contents, created: str = "") -> None:
        self._store = store
        known = {node.key: store.actions.known(node.key) for _, node in contents.nodes() if node.result is not None}
        self._documents = {result.digest: result.document for result in known.values() if result is not None}
        """Digest -> content of parts that are not blobs of the store, such as results, which are parts of entries."""
        self._packs: dict[str, list[str]] = {}
        """Digest of a layer -> the blobs in it."""
        needed, _ = closure.of(contents, self._get, store.actions)
        self._sizes = {digest: self._size(digest) for digest in needed}
        layers = tuple(map(self._layer, packs(self._sizes)))
        config = self._keep(oci.CONFIG, contents.spell())
        self.manifest = Manifest(config, layers, annotations={oci.CREATED: created} if created else {})

    @property
    def digest(self) -> str:
        """The digest that a signature covers."""
        return self.manifest.digest

    def attach(self, signature: bytes) -> None:
        """Add a signature as the last layer."""
        self.manifest = replace(self.manifest, signature=self._keep(oci.SIGNATURE, signature))

    def write(self, path: Path) -> None:
        """Write the bundle as a file `NAME.tar`.

        Raises:
            UsageError: `path` does not end in `.tar`, or is a folder.
            StoreError: The disk is full, `path` cannot be written, or a blob of the store is damaged.
        """
        if path.suffix != ".tar" or path.is_dir():
            raise UsageError(
                f"`{path}` is not the name of a `.tar` file", code="DXB-U140", hint=f"`-o {path.with_suffix('.tar')}`"
            )
        place = os.path.abspath(path)
        files.clear(os.path.dirname(place))
        with files.new_file(place, 0o644) as descriptor:
            for chunk in archive(self._files()):
                files.write_all(descriptor, chunk)

    def _files(self) -> Iterator[tuple[str, int, Iterable[bytes]]]:
        """Name, size and content of every file of the layout."""
        for layer in self.manifest.layers:
            yield layout.BLOBS + layer.digest, layer.size, self._pack(self._packs[layer.digest])
        manifest = self._keep(oci.MANIFEST, self.manifest.spell())
        for part in filter(None, (self.manifest.config, self.manifest.signature, manifest)):
            yield layout.BLOBS + part.digest, part.size, [self._documents[part.digest]]
        for name, data in (("oci-layout", digests.canonical(oci.VERSION)), ("index.json", oci.spell_index(manifest))):
            yield name, len(data), [data]

    def _pack(self, blobs: list[str]) -> Iterator[bytes]:
        return archive((f"cas/{digest}", self._sizes[digest], self._read(digest)) for digest in blobs)

    def _layer(self, blobs: list[str]) -> Descriptor:
        state, size = hashlib.sha256(), 0
        for chunk in self._pack(blobs):
            state.update(chunk)
            size += len(chunk)
        self._packs[state.hexdigest()] = blobs
        return Descriptor(oci.PACK, state.hexdigest(), size)

    def _keep(self, media_type: str, data: bytes) -> Descriptor:
        found = Descriptor(media_type, digests.of_bytes(data), len(data))
        self._documents[found.digest] = data
        return found

    def _get(self, digest: str) -> bytes:
        return self._documents.get(digest) or self._store.blobs.get(digest)

    def _read(self, digest: str) -> Iterator[bytes]:
        """The pieces of a blob, after verifying its digest."""
        if digest in self._documents:
            yield self._documents[digest]
            return
        with self._store.blobs.checked(digest) as file:
            yield from iter(lambda: file.read(_CHUNK), b"")

    def _size(self, digest: str) -> int:
        size = len(self._documents.get(digest, b"")) or self._store.blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        return size


def packs(sizes: Mapping[str, int]) -> list[list[str]]:
    """Assign blobs (digest -> bytes) to archives of bounded size; the same blobs give the same archives.

    Blobs are grouped by digest prefix, so an added or removed blob changes only its own archive: a registry that has
    the last bundle receives little of the next.
    """
    most = max(_PACK, sum(sizes.values()) // _MANY)

    def split(part: list[str], digits: int) -> list[list[str]]:
        octets = sum(sizes[digest] + 2 * tarfile.BLOCKSIZE for digest in part)
        if len(part) <= 1 or (octets <= most and len(part) <= layout.MOST_FILES):
            return [part]
        groups = groupby(part, key=lambda digest: digest[: digits + 1])
        return [pack for _, group in groups for pack in split(list(group), digits + 1)]

    return split(sorted(sizes), 0) if sizes else []


def archive(parts: Iterable[tuple[str, int, Iterable[bytes]]]) -> Iterator[bytes]:
    """The bytes of a tar archive of files (name, size, content).

    Headers name no owner and no time: equal files give equal archives.
    """
    for name, size, chunks in parts:
        info = tarfile.TarInfo(name)
        info.size, info.mode = size, 0o444
        yield info.tobuf(tarfile.GNU_FORMAT, "ascii", "strict")
        yield from chunks
        yield bytes(-size % tarfile.BLOCKSIZE)
    yield bytes(2 * tarfile.BLOCKSIZE)
