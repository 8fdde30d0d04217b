"""Imports bundles into a store. Everything in a bundle is checked.

Blobs are written under the digest of the received bytes, whatever the bundle claims. After all results were checked,
they are written by the same code that a build uses. A refused bundle leaves at most unreferenced blobs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dextera_build.bundle import closure, layout, oci
from dextera_build.bundle.config import Contents
from dextera_build.bundle.errors import BundleRefused, archive, damaged, ill_formed, lacking, too_large
from dextera_build.bundle.layout import Layout
from dextera_build.bundle.oci import Descriptor, Manifest
from dextera_build.store import disk_full, failpoints
from dextera_build.store.blobs import MissingBlob, is_digest
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from dextera_build.store.traces import publish

MOST_DOCUMENT = 64 << 20
"""Largest key document or `result.json` [bytes]."""
_CHUNK = 1 << 20


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
    return Opened(source, manifest, Contents.read(source.whole(manifest.config, "the config", oci.MOST_CONFIG)))


def take(bundle: Opened, store: Store) -> Taken:
    """Import all blobs and results of a bundle.

    Raises:
        BundleRefused: Something in it is wrong; no result was written.
        StoreError: The disk is full, or the store cannot be written.
    """
    free = disk_full.free_bytes(store.root)
    if bundle.size > free:
        raise BundleRefused(
            "the bundle does not fit on the disk of the store",
            code="DXB-S308",
            facts={"bytes": bundle.size, "free": free},
            hint="make room, or set `DXB_CACHE` to a larger disk",
        )
    sizes: dict[str, int] = {}
    for layer in bundle.manifest.layers:
        _receive(bundle.source, layer, store, sizes)

    def read(digest: str) -> bytes:
        if sizes.get(digest, 0) > MOST_DOCUMENT:
            raise too_large("a document", sizes[digest], MOST_DOCUMENT)
        return store.blobs.get(digest)

    try:
        needed, results = closure.of(bundle.contents, read, store.actions)
    except MissingBlob as error:
        raise lacking("a blob that a node needs", error.digest) from None
    if missing := sorted(needed - sizes.keys()):
        raise lacking(f"{len(missing)} of the blobs that its results name", missing[0])
    if loose := sorted(sizes.keys() - needed):
        raise ill_formed("a layer", f"it holds {len(loose)} blobs that no result names, first `{loose[0][:12]}`")
    return _publish(bundle.contents, results, store)


def _receive(source: Layout, layer: Descriptor, store: Store, sizes: dict[str, int]) -> None:
    """Write the blobs of one layer to the store, and add their sizes to `sizes`."""
    with source.part(layer) as part, layout.reading("a layer", part) as packed:
        for info in layout.files(packed):
            folder, _, digest = info.name.partition("/")
            if folder != "cas" or not is_digest(digest):
                raise archive(info.name, "is not named by a digest")
            if digest in sizes:
                raise archive(digest, "occurs twice")
            sizes[digest] = info.size
            with packed.extractfile(info) as file:  # type: ignore[union-attr]
                if not store.blobs.receive(digest, info.size, iter(lambda: file.read(_CHUNK), b"")):
                    raise damaged("a blob", digest, "has other bytes than its name states")


def _publish(contents: Contents, results: Mapping[str, ActionResult], store: Store) -> Taken:
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
            publish(store, node.key, results[node.key], may_lack=not node.is_whole)
            new, bare = new + 1, bare + (not node.is_whole)
        elif here.result.output == node.output:
            known += 1
        else:
            other.append(address)
    return Taken(new, bare, known, tuple(other))
