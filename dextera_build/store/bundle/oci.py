"""The words of OCI: descriptors, manifests, and the media types of a bundle (image-spec 1.1)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from dextera_build import digest as digests
from dextera_build.store.bundle import documents
from dextera_build.store.bundle.refusal import ill_formed, too_large
from dextera_build.store.cas import is_digest

MANIFEST = "application/vnd.oci.image.manifest.v1+json"
INDEX = "application/vnd.oci.image.index.v1+json"
EMPTY = "application/vnd.oci.empty.v1+json"
BUNDLE = "application/vnd.dextera.bundle.v1"
"""`artifactType` of a bundle's manifest."""
CONFIG = "application/vnd.dextera.bundle.config.v1+json"
PACK = "application/vnd.dextera.bundle.blobs.v1.tar"
"""Many small blobs, one file each."""
BLOB = "application/vnd.dextera.blob.v1"
"""One blob, as it is."""
RECIPE = "application/vnd.dextera.recipe.v1+yaml"
IN_TOTO = "application/vnd.in-toto+json"
DSSE = "application/vnd.dsse.envelope.v1+json"
ATTESTATIONS = (IN_TOTO, DSSE)

TITLE = "org.opencontainers.image.title"
CREATED = "org.opencontainers.image.created"
REF = "org.opencontainers.image.ref.name"
PREDICATE = "in-toto.io/predicate-type"

MOST_MANIFEST = 4 << 20
"""Bytes of a manifest or an index; registries take no more."""
MOST_CONFIG = 128 << 20
MOST_LAYERS = 10_000
MOST_MANIFESTS = 256
"""Entries of an index: a bundle, and what is said of it."""
EMPTY_BYTES = b"{}"


@dataclass(frozen=True)
class Descriptor:
    """Names bytes: of which type, how many, with which digest."""

    media_type: str
    digest: str
    """Lower-case hex SHA-256."""
    size: int
    artifact_type: str = ""
    annotations: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, media_type: str, data: bytes, **annotations: str) -> Descriptor:
        """The descriptor of some bytes."""
        return cls(media_type, digests.of_bytes(data), len(data), annotations=annotations)

    @classmethod
    def read(cls, raw: object, what: str) -> Descriptor:
        """The descriptor that stands in a document.

        Raises:
            BundleRefused: None does.
        """
        reader = documents.Reader(raw, what)
        algorithm, _, digest = reader.text("digest").partition(":")
        if algorithm != "sha256" or not is_digest(digest):
            raise ill_formed(what, "`digest` is not a SHA-256 digest")
        return cls(
            reader.text("mediaType"),
            digest,
            reader.count("size"),
            reader.text("artifactType", ""),
            reader.table("annotations", needed=False),
        )

    def spell(self) -> dict[str, Any]:
        """As it stands in a document."""
        found: dict[str, Any] = {"mediaType": self.media_type, "digest": f"sha256:{self.digest}", "size": self.size}
        if self.artifact_type:
            found["artifactType"] = self.artifact_type
        if self.annotations:
            found["annotations"] = dict(self.annotations)
        return found


@dataclass(frozen=True)
class Manifest:
    """What belongs together under one digest."""

    artifact_type: str
    config: Descriptor
    layers: tuple[Descriptor, ...]
    subject: Descriptor | None = None
    annotations: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, data: bytes) -> Manifest:
        """The manifest that `data` spells.

        Raises:
            BundleRefused: It spells none.
        """
        reader = documents.Reader(documents.parse(data, "the manifest"), "the manifest")
        if reader.raw.get("schemaVersion") != 2 or reader.text("mediaType") != MANIFEST:
            raise ill_formed("the manifest", f"it is not of type `{MANIFEST}`")
        layers = reader.items("layers")
        if len(layers) > MOST_LAYERS:
            raise too_large("the list of layers", len(layers), MOST_LAYERS)
        subject = reader.raw.get("subject")
        return cls(
            reader.text("artifactType", ""),
            Descriptor.read(reader.raw.get("config"), "the manifest's `config`"),
            tuple(Descriptor.read(layer, "a layer") for layer in layers),
            Descriptor.read(subject, "the manifest's `subject`") if subject is not None else None,
            reader.table("annotations", needed=False),
        )

    def spell(self) -> bytes:
        """The one spelling of the manifest."""
        raw: dict[str, Any] = {
            "schemaVersion": 2,
            "mediaType": MANIFEST,
            "artifactType": self.artifact_type,
            "config": self.config.spell(),
            "layers": [layer.spell() for layer in self.layers],
        }
        if self.subject is not None:
            raw["subject"] = Descriptor(self.subject.media_type, self.subject.digest, self.subject.size).spell()
        if self.annotations:
            raw["annotations"] = dict(self.annotations)
        return digests.canonical(raw)

    def parts(self) -> Iterator[Descriptor]:
        """Config and layers, each digest once."""
        yield from {part.digest: part for part in (self.config, *self.layers)}.values()


def spell_index(manifests: Sequence[Descriptor]) -> bytes:
    """An image index of these manifests."""
    return digests.canonical(
        {"schemaVersion": 2, "mediaType": INDEX, "manifests": [manifest.spell() for manifest in manifests]}
    )


def read_index(data: bytes) -> list[Descriptor]:
    """The manifests that an image index names.

    Raises:
        BundleRefused: It is none.
    """
    reader = documents.Reader(documents.parse(data, "the index"), "the index")
    if reader.raw.get("schemaVersion") != 2:
        raise ill_formed("the index", f"it is not of type `{INDEX}`")
    entries = reader.items("manifests")
    if len(entries) > MOST_MANIFESTS:
        raise too_large("the index", len(entries), MOST_MANIFESTS)
    # Each once: whoever reads the manifests reads up to 4 MiB an entry.
    return list(
        {found.digest: found for found in (Descriptor.read(raw, "an entry of the index") for raw in entries)}.values()
    )


class Source(Protocol):
    """Where a bundle is read from: a folder, an archive, a registry, or a store that it is made of."""

    name: str
    """As the command line names it."""

    def manifests(self) -> list[Descriptor]:
        """The bundle's manifest first, then those that say something of it."""
        ...

    def chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        """Bytes as they lie there, in pieces; whoever reads them checks them."""
        ...


class Sink(Protocol):
    """Where a bundle is written to."""

    def has(self, part: Descriptor) -> bool:
        """Whether these bytes need not be written."""
        ...

    def write(self, part: Descriptor, chunks: Iterator[bytes]) -> None:
        """Take the bytes of a config or layer."""
        ...

    def manifest(self, found: Descriptor, data: bytes) -> None:
        """Take a manifest, all of whose parts were written."""
        ...
