"""A bundle that is made of what a store holds, piece by piece as it is read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace

from dextera_build.store import files
from dextera_build.store.bundle import closure, oci, packs
from dextera_build.store.bundle.contents import Contents
from dextera_build.store.bundle.oci import Descriptor, Manifest
from dextera_build.store.cas import Blobs, MissingBlob
from dextera_build.store.store import Store


class Made:
    """A source: the bundle of some nodes of a store.

    Args:
        store: Holds all that the nodes need.
        contents: The nodes.
        recipes: Address -> YAML.
        created: When the results were made, as RFC 3339; "" where that is not known.
        large: Least size of a blob that is a layer of its own [bytes].

    Raises:
        MissingBlob: The store lacks something.
        BundleRefused: A document in the store is not what it must be.
    """

    def __init__(
        self,
        store: Store,
        contents: Contents,
        recipes: Mapping[str, bytes],
        created: str = "",
        large: int = packs.LARGE,
    ) -> None:
        self.name = "the store"
        self.contents = contents
        self._blobs = store.blobs
        self._documents: dict[str, bytes] = {}
        self._layers: dict[str, packs.Layer] = {}
        config = self._keep(oci.CONFIG, contents.spell())
        texts = [self._keep(oci.RECIPE, recipes[name], f"recipes/{name}.yaml") for name in sorted(recipes)]
        needed = closure.of(contents, store.blobs.get).blobs
        texts = list({text.digest: text for text in texts}.values())
        held = [self._layer(layer, n) for n, layer in enumerate(packs.layers(_sizes(store.blobs, needed), large))]
        manifest = Manifest(oci.BUNDLE, config, (*texts, *held), annotations=_annotations(contents, created))
        self.manifest = replace(self._keep(oci.MANIFEST, manifest.spell()), artifact_type=oci.BUNDLE)
        self._manifests = [self.manifest]

    def manifests(self) -> list[Descriptor]:
        """The bundle's manifest, then that of its provenance."""
        return list(self._manifests)

    def chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        """The bytes of a manifest, config or layer."""
        if wanted.digest in self._documents:
            yield self._documents[wanted.digest]
        else:
            yield from self._layers[wanted.digest].chunks(self._read)

    def attach(self, media_type: str, document: bytes, **annotations: str) -> None:
        """Say something of the bundle: a document of its own whose subject is the bundle."""
        layer = self._keep(media_type, document, **{oci.TITLE: "provenance.json", **annotations})
        empty = self._keep(oci.EMPTY, oci.EMPTY_BYTES)
        manifest = Manifest(media_type, empty, (layer,), self.manifest)
        self._manifests.append(replace(self._keep(oci.MANIFEST, manifest.spell()), artifact_type=media_type))

    def _keep(self, media_type: str, data: bytes, title: str = "", **annotations: str) -> Descriptor:
        found = Descriptor.of(media_type, data, **({oci.TITLE: title} if title else {}), **annotations)
        self._documents[found.digest] = data
        return found

    def _layer(self, layer: packs.Layer, number: int) -> Descriptor:
        found = layer.describe(self._read, number)
        self._layers[found.digest] = layer
        return found

    def _read(self, digest: str) -> Iterator[bytes]:
        """A blob in pieces, followed by the check of its digest."""
        state = hashlib.sha256()
        try:
            with open(self._blobs.path(digest), "rb") as file:
                for chunk in files.chunks(file.fileno()):
                    state.update(chunk)
                    yield chunk
        except OSError:
            raise MissingBlob(digest) from None
        if state.hexdigest() != digest:
            self._blobs.quarantine(digest)
            raise MissingBlob(digest, "its bytes were damaged, it was set aside")


def _sizes(blobs: Blobs, needed: set[str]) -> dict[str, int]:
    found = {}
    for digest in sorted(needed):
        size = blobs.size(digest)
        if size is None:
            raise MissingBlob(digest)
        found[digest] = size
    return found


def _annotations(contents: Contents, created: str) -> dict[str, str]:
    count = sum(len(build.nodes) for build in contents.builds)
    shown = contents.targets()
    found = {
        "vnd.dextera.bundle.targets": " ".join(shown[:8]) + (f" and {len(shown) - 8} more" if len(shown) > 8 else ""),
        "vnd.dextera.bundle.recipes": " ".join(build.recipe for build in contents.builds[:8]),
        "vnd.dextera.bundle.nodes": str(count),
        "vnd.dextera.bundle.closure": contents.closure,
    }
    return {oci.CREATED: created, **found} if created else found
