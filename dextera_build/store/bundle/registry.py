"""OCI registries, by the distribution spec (1.1): repositories that bundles are pushed to and read from.

The client library `oras` (PyPI) reads a blob whole into memory to upload it, and brings a second HTTP library, so this
speaks HTTP itself; the tests read with `oras` and `skopeo` what was pushed here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from urllib.parse import urljoin

from dextera_build import digest as digests
from dextera_build.errors import UsageError
from dextera_build.store.bundle import checked, oci
from dextera_build.store.bundle.oci import Descriptor, Manifest, Source
from dextera_build.store.bundle.refusal import damaged, lacking, not_a_bundle, too_large
from dextera_build.store.bundle.registry_http import Connection, RegistryError

if TYPE_CHECKING:
    import httpx

PIECE = 16 << 20
"""A blob beyond this goes up in pieces [bytes]."""
_REFERENCE = re.compile(
    r"oci://(?P<host>(?:[A-Za-z0-9.-]+|\[[0-9a-fA-F:]+\])(?::\d+)?)/"
    r"(?P<name>[a-z0-9]+(?:[._/-]+[a-z0-9]+)*)"
    r"(?::(?P<tag>\w[\w.-]{0,127})|@sha256:(?P<digest>[0-9a-f]{64}))"
)
_ACCEPT = {"Accept": f"{oci.MANIFEST}, {oci.INDEX}"}


@dataclass(frozen=True)
class Reference:
    """`oci://HOST/NAME:TAG` or `oci://HOST/NAME@sha256:...`."""

    host: str
    name: str
    tag: str
    """A tag, or `sha256:...`."""

    def __str__(self) -> str:
        """As the command line takes it."""
        return f"oci://{self.host}/{self.name}{'@' if ':' in self.tag else ':'}{self.tag}"


def parse(text: str) -> Reference:
    """The reference that a text spells.

    Raises:
        UsageError: It spells none.
    """
    found = _REFERENCE.fullmatch(text)
    if found is None:
        raise UsageError(
            f"`{text}` is not of the form `oci://HOST/NAME:TAG`",
            code="DXB-U147",
            hint="names in registries are in lower case: `oci://ghcr.io/someone/twins:v1`",
        )
    digest = found["digest"]
    return Reference(found["host"], found["name"], f"sha256:{digest}" if digest else found["tag"])


class Repository:
    """A source and a sink: one repository of a registry.

    Args:
        place: The repository, and what of it is read or written.

    Raises:
        MachineError: The package for HTTP is not installed.
    """

    def __init__(self, place: Reference) -> None:
        self.name = str(place)
        self._place = place
        self._http = Connection(place.host, place.name)
        self._first = True

    def manifests(self) -> list[Descriptor]:
        """The manifest under the tag, then those that say something of it."""
        data, kind = self._manifest(self._place.tag)
        if kind != oci.MANIFEST:
            raise not_a_bundle(self.name, f"it is of type `{kind}`")
        found = Descriptor(oci.MANIFEST, digests.of_bytes(data), len(data))
        if self._place.tag.startswith("sha256:") and self._place.tag != f"sha256:{found.digest}":
            raise damaged("the manifest", self._place.tag, "has other bytes")
        found = replace(found, artifact_type=Manifest.read(data).artifact_type)
        return [found, *(said for said in self._referrers(found) if said.artifact_type in oci.ATTESTATIONS)]

    def chunks(self, wanted: Descriptor) -> Iterator[bytes]:
        """The bytes of a manifest, config or layer."""
        if wanted.media_type == oci.MANIFEST:
            yield self._manifest(f"sha256:{wanted.digest}")[0]
            return
        with self._http.stream("GET", f"blobs/sha256:{wanted.digest}") as answer:
            if answer.status_code == 404:
                raise lacking(f"a part of type `{wanted.media_type}`", wanted.digest)
            self._http.expect(answer, 200)
            # Not decoded: what was pushed is what is read, and nothing unpacks to more than was sent.
            yield from answer.iter_raw(1 << 20)

    def has(self, part: Descriptor) -> bool:
        """Whether the repository holds these bytes."""
        answer = self._http.ask("HEAD", f"blobs/sha256:{part.digest}")
        if answer.status_code == 404:
            return False
        self._http.expect(answer, 200)
        return True

    def write(self, part: Descriptor, chunks: Iterator[bytes]) -> None:
        """Upload a blob; a large one in pieces."""
        answer = self._http.expect(self._http.ask("POST", "blobs/uploads/"), 202)
        place, start = self._location(answer), 0
        if part.size > PIECE:
            for piece in _pieces(chunks):
                headers = {"Content-Range": f"{start}-{start + len(piece) - 1}"}
                place = self._location(self._http.expect(self._send("PATCH", place, piece, headers), 202))
                start += len(piece)
            rest = b""
        else:
            rest = b"".join(chunks)
        mark = "&" if "?" in place else "?"
        self._http.expect(self._send("PUT", f"{place}{mark}digest=sha256:{part.digest}", rest, {}), 201)

    def manifest(self, found: Descriptor, data: bytes) -> None:
        """Put a manifest: the bundle's under the tag, what is said of it under its digest."""
        tag = self._place.tag if self._first else f"sha256:{found.digest}"
        self._first = False
        answer = self._http.ask("PUT", f"manifests/{tag}", data, {"Content-Type": oci.MANIFEST})
        self._http.expect(answer, 201)
        subject = Manifest.read(data).subject
        if subject is not None and "OCI-Subject" not in answer.headers:
            self._refer(subject, found)

    def _refer(self, subject: Descriptor, found: Descriptor) -> None:
        """Note in an index under a tag what is said of a manifest, where the registry does not do so by itself."""
        known = {each.digest: each for each in (*self._referrers(subject), found)}
        index = oci.spell_index(list(known.values()))
        answer = self._http.ask("PUT", f"manifests/sha256-{subject.digest}", index, {"Content-Type": oci.INDEX})
        self._http.expect(answer, 201)

    def _referrers(self, subject: Descriptor) -> list[Descriptor]:
        """What is said of a manifest: by the referrers API, or else by the index under its tag."""
        for path in (f"referrers/sha256:{subject.digest}", f"manifests/sha256-{subject.digest}"):
            with self._http.stream("GET", path, {"Accept": oci.INDEX}) as answer:
                if answer.status_code == 200 and answer.headers.get("Content-Type", "").split(";")[0] == oci.INDEX:
                    return oci.read_index(_bounded(answer, "the list of what is said of it"))
        return []

    def _manifest(self, tag: str) -> tuple[bytes, str]:
        with self._http.stream("GET", f"manifests/{tag}", _ACCEPT) as answer:
            if answer.status_code == 404:
                raise RegistryError(
                    f"`{self._place.host}` has no `{self._place.name}` at `{tag}`",
                    code="DXB-E341",
                    hint="dxb bundle push RECIPE " + self.name,
                )
            self._http.expect(answer, 200)
            return _bounded(answer, "the manifest"), answer.headers.get("Content-Type", "").split(";")[0]

    def _send(self, verb: str, place: str, data: bytes, headers: Mapping[str, str]) -> httpx.Response:
        return self._http.ask(verb, place, data, {"Content-Type": "application/octet-stream", **headers})

    def _location(self, answer: httpx.Response) -> str:
        place: str = answer.headers.get("Location", "")
        return urljoin(str(answer.url), place)


def push(source: Source, place: Reference) -> str:
    """Put a bundle and what is said of it into a repository, and return its address by digest.

    Raises:
        RegistryError: The registry refused.
        BundleRefused: What is pushed is damaged.
    """
    if place.tag.startswith("sha256:"):
        raise UsageError("a bundle is pushed to a tag", code="DXB-U147", hint=f"oci://{place.host}/{place.name}:TAG")
    found = checked.copy(source, Repository(place))
    return str(replace(place, tag=f"sha256:{found[0].digest}"))


def _pieces(chunks: Iterator[bytes]) -> Iterator[bytes]:
    held: list[bytes] = []
    size = 0
    for chunk in chunks:
        held.append(chunk)
        size += len(chunk)
        if size >= PIECE:
            yield b"".join(held)
            held, size = [], 0
    if held:
        yield b"".join(held)


def _bounded(answer: httpx.Response, what: str) -> bytes:
    held: list[bytes] = []
    size = 0
    for chunk in answer.iter_raw(1 << 16):
        size += len(chunk)
        if size > oci.MOST_MANIFEST:
            raise too_large(what, size, oci.MOST_MANIFEST)
        held.append(chunk)
    return b"".join(held)
