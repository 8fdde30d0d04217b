"""OCI image-spec 1.1: descriptors, manifests, and the media types of a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.documents import COUNT, TEXT, Form
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
_OCI_DIGEST = Form(
    "a SHA-256 digest", lambda it: isinstance(it, str) and it[:7] == "sha256:" and is_digest(it.removeprefix("sha256:"))
)


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
        found = documents.check(raw, {"mediaType": TEXT, "digest": _OCI_DIGEST, "size": COUNT}, what)
        return cls(
            found["mediaType"], found["digest"].removeprefix("sha256:"), found["size"], _annotations(found, what)
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
        what = "the manifest"
        raw = documents.parse(data, what)
        if raw.get("schemaVersion") != 2 or raw.get("mediaType") != MANIFEST:
            raise ill_formed(what, f"it is not of type `{MANIFEST}`")
        if raw.get("artifactType") != BUNDLE:
            raise ill_formed(what, f"its artifact type is not `{BUNDLE}`")
        documents.check(raw, {"layers": [{}]}, what)
        if len(raw["layers"]) > MOST_LAYERS:
            raise too_large("the list of layers", len(raw["layers"]), MOST_LAYERS)
        layers = [Descriptor.read(layer, "a layer") for layer in raw["layers"]]
        signature = layers.pop() if layers and layers[-1].media_type == SIGNATURE else None
        config = Descriptor.read(raw.get("config"), "the manifest's `config`")
        found = cls(config, tuple(layers), signature, _annotations(raw, what))
        if found.spell() != data:
            raise ill_formed(what, "it is not spelled as dxb spells it")
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
    raw = documents.check(documents.parse(data, "the index"), {"manifests": [{}]}, "the index")
    if raw.get("schemaVersion") != 2:
        raise ill_formed("the index", f"it is not of type `{INDEX}`")
    found = [Descriptor.read(entry, "an entry of the index") for entry in raw["manifests"]]
    return list({manifest.digest: manifest for manifest in found}.values())


def _annotations(raw: Mapping[str, Any], what: str) -> dict[str, str]:
    return dict(documents.check(raw.get("annotations", {}), {TEXT: TEXT}, what, "annotations"))
