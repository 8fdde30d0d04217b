"""A bundle that is made of what a store holds, piece by piece as it is read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import replace

from dextera_build import digest as digests
from dextera_build.store.bundle import closure, oci, packs
from dextera_build.store.bundle.contents import Contents
from dextera_build.store.bundle.oci import Descriptor, Manifest
from dextera_build.store.cas import MissingBlob
from dextera_build.store.store import Store

_CHUNK = 1 << 20


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
        self._store = store
        self._keys = {node.result: node.key for _, node in contents.nodes() if node.result is not None}
        """Digest of a `result.json` -> key of the entry that may hold it."""
        self._documents: dict[str, bytes] = {}
        self._layers: dict[str, packs.Layer] = {}
        config = self._keep(oci.CONFIG, contents.spell())
        texts = [self._keep(oci.RECIPE, recipes[name], f"recipes/{name}.yaml") for name in sorted(recipes)]
        needed = closure.of(contents, self.get).blobs
        texts = list({text.digest: text for text in texts}.values())
        held = [self._layer(layer, n) for n, layer in enumerate(packs.layers(self._sizes(needed), large))]
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

    def get(self, digest: str) -> bytes:
        """The bytes of a small blob, or of a part that an entry holds.

        Raises:
            MissingBlob: The store lacks it.
        """
        return self._inside(digest) or self._store.blobs.get(digest)

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
        data, state = self._inside(digest), hashlib.sha256()
        if data:
            yield data
            return
        try:
            with self._store.blobs.open(digest) as file:
                while chunk := file.read(_CHUNK):
                    state.update(chunk)
                    yield chunk
        except OSError:
            raise MissingBlob(digest) from None
        if state.hexdigest() != digest:
            self._store.blobs.quarantine(digest)
            raise MissingBlob(digest, "its bytes were damaged, it was set aside")

    def _inside(self, digest: str) -> bytes:
        """A `result.json` as its entry holds it, b"" where no entry does."""
        known = self._store.actions.known(self._keys[digest]) if digest in self._keys else None
        document = known.document if known is not None else b""
        return document if digests.of_bytes(document) == digest else b""

    def _sizes(self, needed: set[str]) -> dict[str, int]:
        found = {}
        for digest in sorted(needed):
            size = len(self._inside(digest)) or self._store.blobs.size(digest)
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
