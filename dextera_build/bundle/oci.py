"""OCI image-spec 1.1: descriptors, manifests, and the media types of a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.documents import COUNT, TEXT, Form
from dextera_build.bundle.errors import ill_formed
from dextera_build.store.blobs import is_digest

MANIFEST = "application/vnd.oci.image.manifest.v1+json"
INDEX = "application/vnd.oci.image.index.v1+json"
BUNDLE = "application/vnd.dextera.bundle.v1"
"""`artifactType` of a bundle's manifest."""
CONFIG = "application/vnd.dextera.bundle.config.v1+json"
PACK = "application/vnd.dextera.bundle.blobs.v1.tar"
"""Blobs, one file each."""
SIGNATURE = "application/vnd.dextera.bundle.signature.v1+json"
CREATED = "org.opencontainers.image.created"
_REF = "org.opencontainers.image.ref.name"
VERSION = {"imageLayoutVersion": "1.0.0"}
"""The content of `oci-layout`."""

MOST_MANIFEST = 4 << 20
"""Largest manifest or index [bytes]; registries accept no larger ones."""
MOST_CONFIG = 128 << 20
_OCI_DIGEST = Form(
    "a SHA-256 digest", lambda it: isinstance(it, str) and it[:7] == "sha256:" and is_digest(it.removeprefix("sha256:"))
)
_DESCRIPTOR = {"mediaType": TEXT, "digest": _OCI_DIGEST, "size": COUNT}


class Descriptor(NamedTuple):
    """Media type, digest and size of some bytes."""

    media_type: str
    digest: str
    """Lower-case hex SHA-256."""
    size: int

    @classmethod
    def read(cls, raw: Mapping[str, Any]) -> Descriptor:
        """From JSON that has the form of a descriptor."""
        return cls(raw["mediaType"], raw["digest"].removeprefix("sha256:"), raw["size"])

    def plain(self) -> dict[str, Any]:
        """As JSON."""
        return {"mediaType": self.media_type, "digest": f"sha256:{self.digest}", "size": self.size}


@dataclass(frozen=True)
class Manifest:
    """The manifest of a bundle."""

    config: Descriptor
    layers: tuple[Descriptor, ...]
    """Archives of blobs."""
    signature: Descriptor | None = None
    """The last layer, which signs the manifest without this layer."""
    annotations: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, data: bytes) -> Manifest:
        """Parse an untrusted manifest.

        Raises:
            BundleRefused: It is malformed, or does not describe a bundle.
        """
        what = "the manifest"
        form = {"config": _DESCRIPTOR, "layers": [_DESCRIPTOR], "annotations": {TEXT: TEXT}}
        raw = documents.parse(data, form, what)
        config, *layers = map(Descriptor.read, (raw["config"], *raw["layers"]))
        signature = layers.pop() if layers and layers[-1].media_type == SIGNATURE else None
        found = cls(config, tuple(layers), signature, raw["annotations"])
        types = (raw.get("artifactType"), config.media_type, *(layer.media_type for layer in layers))
        if not all(kind in (BUNDLE, CONFIG, PACK) for kind in types):
            raise ill_formed(what, f"it is not of type `{BUNDLE}`")
        if len({part.digest for part in (config, *layers)}) != 1 + len(layers):
            raise ill_formed(what, "a layer is listed twice")
        documents.refuse_other_spelling(data, found._plain(), what)
        return found

    @property
    def digest(self) -> str:
        """Digest of the manifest without its signature, which covers it."""
        return digests.of_bytes(replace(self, signature=None).spell())

    def spell(self) -> bytes:
        """Canonical JSON."""
        return digests.canonical(self._plain())

    def _plain(self) -> dict[str, Any]:
        return {
            "schemaVersion": 2,
            "mediaType": MANIFEST,
            "artifactType": BUNDLE,
            "config": self.config.plain(),
            "layers": [layer.plain() for layer in (*self.layers, self.signature) if layer is not None],
            "annotations": dict(self.annotations),
        }


def spell_index(manifest: Descriptor) -> bytes:
    """The index of a layout; other programs name the bundle as `oci:FOLDER:bundle`."""
    named = manifest.plain() | {"annotations": {_REF: "bundle"}}
    return digests.canonical({"schemaVersion": 2, "mediaType": INDEX, "manifests": [named]})


def read_index(data: bytes) -> list[Descriptor]:
    """The manifests that an image index names, without duplicates.

    Raises:
        BundleRefused: It is malformed.
    """
    raw = documents.parse(data, {"manifests": [_DESCRIPTOR]}, "the index")
    return list(dict.fromkeys(map(Descriptor.read, raw["manifests"])))
