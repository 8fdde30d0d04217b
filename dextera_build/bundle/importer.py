"""Imports bundles into a store. Everything in a bundle is checked.

Blobs are written under the digest of what came, whatever the bundle says; results are written last, by the same code
that a build uses, after all of them were checked. What is refused leaves at most blobs behind that nothing names.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

from dextera_build.bundle import closure, oci, tar
from dextera_build.bundle.config import Contents
from dextera_build.bundle.errors import BundleRefused, archive, ill_formed, lacking, too_large
from dextera_build.bundle.layout import Layout
from dextera_build.bundle.oci import Descriptor, Manifest
from dextera_build.store import disk_full, failpoints
from dextera_build.store.blobs import is_digest
from dextera_build.store.store import Store
from dextera_build.store.traces import publish

MOST_DOCUMENT = 64 << 20
"""Bytes of a key document, a header or a `result.json`."""
_KINDS = {oci.PACK, oci.BLOB}


@dataclass(frozen=True)
class Opened:
    """A bundle whose manifest and config were read and checked."""

    source: Layout
    manifest: Manifest
    contents: Contents

    @property
    def digest(self) -> str:
        """The digest that a signature covers."""
        return self.manifest.digest

    @property
    def size(self) -> int:
        """Bytes of all layers."""
        return sum(layer.size for layer in self.manifest.layers)


@dataclass(frozen=True)
class Taken:
    """The outcome of an import."""

    new: int
    """Results that were missing from the store, or were bare there."""
    bare: int
    """How many of them are bare."""
    known: int
    """Results that the store already had."""
    other: tuple[str, ...]
    """Nodes whose key has another output in the store, which keeps its own."""


def open_bundle(source: Layout) -> Opened:
    """Read the manifest and the config of a bundle.

    Raises:
        BundleRefused: It is not a bundle, or is malformed.
    """
    manifest = Manifest.read(source.whole(source.manifest(), "the manifest", oci.MOST_MANIFEST))
    if manifest.config.media_type != oci.CONFIG:
        raise ill_formed("the manifest", f"its config is not of type `{oci.CONFIG}`")
    digests = {manifest.config.digest, *(layer.digest for layer in manifest.layers)}
    if len(digests) != 1 + len(manifest.layers):
        raise ill_formed("the manifest", "a layer stands twice")
    for layer in manifest.layers:
        if layer.media_type not in _KINDS:
            raise ill_formed("the manifest", f"`{layer.media_type}` is no type of its layers")
    return Opened(source, manifest, Contents.read(source.whole(manifest.config, "the config", oci.MOST_CONFIG)))


def take(bundle: Opened, store: Store) -> Taken:
    """Import all blobs and results of a bundle.

    Raises:
        BundleRefused: Something in it is wrong; no result was written.
        StoreError: The disk is full, or the store cannot be written.
    """
    _refuse_without_room(bundle, store)
    inbox = _Inbox(bundle, store)
    for layer in bundle.manifest.layers:
        inbox.layer(layer)
    found = closure.of(bundle.contents, inbox.read)
    missing = sorted(found.blobs - inbox.sizes.keys())
    if missing:
        raise lacking(f"{len(missing)} of the blobs that its results name", missing[0])
    loose = sorted(inbox.sizes.keys() - found.blobs)
    if loose:
        raise ill_formed(
            "a layer", f"it holds blobs that no result names, `{loose[0][:12]}` is the first of {len(loose)}"
        )
    return _publish(bundle.contents, found, store)


def _publish(contents: Contents, found: closure.Closure, store: Store) -> Taken:
    """Write the results that the store lacks."""
    failpoints.reach("import.blobs")
    new = bare = known = 0
    other: list[str] = []
    done: set[str] = set()
    # Nodes can share a key while the bundle is whole for only one of them, so whole ones go first.
    for address, node in sorted(contents.nodes(), key=lambda each: not each[1].is_whole):
        if node.result is None or node.key in done:
            continue
        done.add(node.key)
        here = store.actions.find(node.key)
        if here is None or (node.is_whole and not here.is_whole):
            publish(store, node.key, found.results[node.key], may_lack=not node.is_whole)
            new, bare = new + 1, bare + (not node.is_whole)
        elif here.result.output == node.output:
            known += 1
        else:
            other.append(address)
    return Taken(new, bare, known, tuple(other))


class _Inbox:
    """Writes the blobs of a bundle to the store."""

    def __init__(self, bundle: Opened, store: Store) -> None:
        self.sizes: dict[str, int] = {}
        self._source = bundle.source
        self._blobs = store.blobs

    def layer(self, layer: Descriptor) -> None:
        """Import the blobs of one layer."""
        chunks = self._source.stream(layer)
        if layer.media_type == oci.BLOB:
            self._take(layer.digest, layer.size, chunks)
        else:
            for name, size, pieces in tar.files(chunks):
                folder, _, digest = name.partition("/")
                if folder != "cas" or not is_digest(digest):
                    raise archive(name[:200], "is not named by a digest")
                self._take(digest, size, pieces)

    def read(self, digest: str) -> bytes:
        """Read a small document of the bundle."""
        if digest not in self.sizes:
            raise lacking("a document that it names", digest)
        if self.sizes[digest] > MOST_DOCUMENT:
            raise too_large("a document", self.sizes[digest], MOST_DOCUMENT)
        return self._blobs.get(digest)

    def _take(self, digest: str, size: int, chunks: Iterator[bytes]) -> None:
        if digest in self.sizes:
            raise archive(digest, "stands twice")
        self.sizes[digest] = size
        if not self._blobs.receive(digest, size, chunks):
            raise BundleRefused(
                "the bundle is damaged: a blob has other bytes than its name says",
                code="DXB-S302",
                facts={"digest": digest},
                hint="download or copy the bundle again",
            )


def _refuse_without_room(bundle: Opened, store: Store) -> None:
    """Refuse a bundle that claims more bytes than the disk has left."""
    state = os.statvfs(store.root)
    if bundle.size > state.f_bavail * state.f_frsize:
        raise BundleRefused(
            "the bundle does not fit on the disk of the store",
            code="DXB-S308",
            facts={"bytes": bundle.size, "free": disk_full.free(str(store.root))},
            hint="make room, or set `DXB_CACHE` to a larger disk",
        )
