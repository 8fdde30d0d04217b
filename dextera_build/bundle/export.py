"""Writes bundles of results in a store. Blobs are streamed, never held in memory."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.bundle import closure, oci, packs, tar
from dextera_build.bundle.config import Contents
from dextera_build.bundle.layout import BLOBS, VERSION
from dextera_build.bundle.oci import Descriptor, Manifest
from dextera_build.errors import UsageError
from dextera_build.store import files
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

_CHUNK = 1 << 20


class Export:
    """The bundle of some nodes of a store.

    Args:
        store: Holds all that the nodes need.
        contents: The nodes.
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
        created: str = "",
        large: int = packs.LARGE,
    ) -> None:
        self.contents = contents
        self._store = store
        self._keys = {node.result: node.key for _, node in contents.nodes() if node.result is not None}
        """Digest of a `result.json` -> key of the entry that may hold it."""
        self._documents: dict[str, bytes] = {}
        self._layers: dict[str, packs.Layer] = {}
        config = self._keep(oci.CONFIG, contents.spell())
        needed = closure.of(contents, self.get).blobs
        held = [self._layer(layer, n) for n, layer in enumerate(packs.layers(self._sizes(needed), large))]
        self.manifest = Manifest(config, tuple(held), annotations=_annotations(contents, created))

    @property
    def digest(self) -> str:
        """The digest that a signature covers."""
        return self.manifest.digest

    def get(self, digest: str) -> bytes:
        """The bytes of a small blob, or of a part that an entry holds.

        Raises:
            MissingBlob: The store lacks it.
        """
        return self._inside(digest) or self._store.blobs.get(digest)

    def attach(self, signature: bytes) -> None:
        """Add a signature as the last layer."""
        self.manifest = replace(self.manifest, signature=self._keep(oci.SIGNATURE, signature, "signature.json"))

    def write(self, path: Path) -> None:
        """Write the bundle as a file `NAME.tar`.

        Raises:
            UsageError: The name is another.
            StoreError: The disk is full, the place cannot be written, or a blob of the store is damaged.
        """
        if path.suffix != ".tar" or path.is_dir():
            raise UsageError(
                f"`{path}` is not the name of a `.tar` file", code="DXB-U140", hint=f"`-o {path.with_suffix('.tar')}`"
            )
        place = os.path.abspath(path)
        files.clear(os.path.dirname(place))
        with files.new_file(place, 0o644) as descriptor:
            for name, size, chunks in self._files():
                files.write_all(descriptor, tar.header(name, size))
                for chunk in chunks:
                    files.write_all(descriptor, chunk)
                files.write_all(descriptor, tar.padding(size))
            files.write_all(descriptor, tar.END)

    def _files(self) -> Iterator[tuple[str, int, Iterator[bytes]]]:
        """Name, size and content of every file."""
        whole = self.manifest
        manifest = self._keep(oci.MANIFEST, whole.spell())
        parts = (whole.config, *whole.layers, *([whole.signature] if whole.signature else []), manifest)
        for part in {part.digest: part for part in parts}.values():
            yield BLOBS + part.digest, part.size, self._chunks(part)
        for name, document in (("oci-layout", VERSION), ("index.json", oci.spell_index(manifest))):
            yield name, len(document), iter([document])

    def _chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        if wanted.digest in self._documents:
            yield self._documents[wanted.digest]
        else:
            yield from self._layers[wanted.digest].chunks(self._read)

    def _keep(self, media_type: str, data: bytes, title: str = "") -> Descriptor:
        found = Descriptor.of(media_type, data, **({oci.TITLE: title} if title else {}))
        self._documents[found.digest] = data
        return found

    def _layer(self, layer: packs.Layer, number: int) -> Descriptor:
        found = layer.describe(self._read, number)
        self._layers[found.digest] = layer
        return found

    def _read(self, digest: str) -> Iterator[bytes]:
        """The pieces of a blob; its digest is checked after the last one."""
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
            raise MissingBlob(digest, "damaged bytes, moved to quarantine")

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
