"""OCI image-spec 1.1: descriptors, manifests, and the media types of a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.errors import ill_formed, too_large
from dextera_build.store.blobs import is_digest

MANIFEST = "application/vnd.oci.image.manifest.v1+json"
INDEX = "application/vnd.oci.image.index.v1+json"
BUNDLE = "application/vnd.dextera.bundle.v1"
"""`artifactType` of a bundle's manifest."""
CONFIG = "application/vnd.dextera.bundle.config.v1+json"
PACK = "application/vnd.dextera.bundle.blobs.v1.tar"
"""Many small blobs, one file each."""
BLOB = "application/vnd.dextera.blob.v1"
"""One blob, as it is."""
SIGNATURE = "application/vnd.dextera.bundle.signature.v1+json"

TITLE = "org.opencontainers.image.title"
CREATED = "org.opencontainers.image.created"
REF = "org.opencontainers.image.ref.name"

MOST_MANIFEST = 4 << 20
"""Bytes of a manifest or an index; registries take no more."""
MOST_CONFIG = 128 << 20
MOST_LAYERS = 10_000


@dataclass(frozen=True)
class Descriptor:
    """Media type, digest and size of some bytes."""

    media_type: str
    digest: str
    """Lower-case hex SHA-256."""
    size: int
    annotations: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, media_type: str, data: bytes, **annotations: str) -> Descriptor:
        """The descriptor of some bytes."""
        return cls(media_type, digests.of_bytes(data), len(data), annotations=annotations)

    @classmethod
    def read(cls, raw: object, what: str) -> Descriptor:
        """Parse an untrusted descriptor.

        Raises:
            BundleRefused: It is malformed.
        """
        reader = documents.Reader(raw, what)
        algorithm, _, digest = reader.text("digest").partition(":")
        if algorithm != "sha256" or not is_digest(digest):
            raise ill_formed(what, "`digest` is not a SHA-256 digest")
        return cls(
            reader.text("mediaType"),
            digest,
            reader.count("size"),
            reader.table("annotations", needed=False),
        )

    def spell(self) -> dict[str, Any]:
        """As JSON."""
        found: dict[str, Any] = {"mediaType": self.media_type, "digest": f"sha256:{self.digest}", "size": self.size}
        if self.annotations:
            found["annotations"] = dict(self.annotations)
        return found


@dataclass(frozen=True)
class Manifest:
    """The manifest of a bundle."""

    config: Descriptor
    layers: tuple[Descriptor, ...]
    """Blobs."""
    signature: Descriptor | None = None
    """The last layer, which is about the manifest without it."""
    annotations: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, data: bytes) -> Manifest:
        """Parse an untrusted manifest.

        Raises:
            BundleRefused: It is malformed, or not canonical JSON.
        """
        reader = documents.Reader(documents.parse(data, "the manifest"), "the manifest")
        if reader.raw.get("schemaVersion") != 2 or reader.text("mediaType") != MANIFEST:
            raise ill_formed("the manifest", f"it is not of type `{MANIFEST}`")
        if reader.text("artifactType", "") != BUNDLE:
            raise ill_formed("the manifest", f"its artifact type is not `{BUNDLE}`")
        items = reader.items("layers")
        if len(items) > MOST_LAYERS:
            raise too_large("the list of layers", len(items), MOST_LAYERS)
        layers = [Descriptor.read(layer, "a layer") for layer in items]
        signature = layers.pop() if layers and layers[-1].media_type == SIGNATURE else None
        config = Descriptor.read(reader.raw.get("config"), "the manifest's `config`")
        found = cls(config, tuple(layers), signature, reader.table("annotations", needed=False))
        if found.spell() != data:
            raise ill_formed("the manifest", "it is not spelled as dxb spells it")
        return found

    @property
    def digest(self) -> str:
        """Digest of the manifest without its signature, which covers it."""
        return digests.of_bytes(replace(self, signature=None).spell())

    def spell(self) -> bytes:
        """Canonical JSON."""
        raw: dict[str, Any] = {
            "schemaVersion": 2,
            "mediaType": MANIFEST,
            "artifactType": BUNDLE,
            "config": self.config.spell(),
            "layers": [layer.spell() for layer in (*self.layers, self.signature) if layer is not None],
        }
        if self.annotations:
            raw["annotations"] = dict(self.annotations)
        return digests.canonical(raw)


def spell_index(manifest: Descriptor) -> bytes:
    """The index of a layout; other programs name the bundle as `oci:FOLDER:bundle`."""
    named = replace(manifest, annotations={REF: "bundle"})
    return digests.canonical({"schemaVersion": 2, "mediaType": INDEX, "manifests": [named.spell()]})


def read_index(data: bytes) -> list[Descriptor]:
    """The manifests that an image index names, without duplicates.

    Raises:
        BundleRefused: It is malformed.
    """
    reader = documents.Reader(documents.parse(data, "the index"), "the index")
    if reader.raw.get("schemaVersion") != 2:
        raise ill_formed("the index", f"it is not of type `{INDEX}`")
    found = [Descriptor.read(raw, "an entry of the index") for raw in reader.items("manifests")]
    return list({manifest.digest: manifest for manifest in found}.values())
