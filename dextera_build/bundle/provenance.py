"""The provenance of a bundle: an in-toto Statement (v1) about its manifest with an SLSA provenance predicate (v1)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.config import Contents, Node
from dextera_build.bundle.errors import ill_formed
from dextera_build.store import headers
from dextera_build.store.blobs import is_digest

STATEMENT = "https://in-toto.io/Statement/v1"
PREDICATE = "https://slsa.dev/provenance/v1"
BUILD = "urn:dextera:build:v1"
"""`buildType`: what `externalParameters` and `internalParameters` mean."""
BUILDER = "urn:dextera:dxb"


@dataclass(frozen=True)
class Circumstances:
    """Facts about the builds."""

    request: Mapping[str, Any] = field(default_factory=dict)
    """Options of the command line: inputs, settings, backends."""
    runs: tuple[str, ...] = ()
    """Ids of the runs that made the targets."""
    created: str = ""
    """When the last of them was made, as RFC 3339."""
    machine: Mapping[str, str] = field(default_factory=dict)
    """Python and system."""


def statement(manifest: str, contents: Contents, read: Callable[[str], bytes], known: Circumstances) -> bytes:
    """The statement about the bundle with this manifest (digest).

    Args:
        manifest: Digest of the manifest; it covers config and layers.
        contents: The nodes.
        read: Gives blobs of the bundle.
        known: What is known beside them.
    """
    meaning: dict[str, Any] = {
        "closure": contents.closure,
        "profiles": sorted({build.profile for build in contents.builds}),
        **known.machine,
    }
    subject = {"name": " ".join(contents.targets())[:2000], "digest": {"sha256": manifest}}
    metadata = {"invocationId": " ".join(known.runs)} if known.runs else {}
    metadata |= {"finishedOn": known.created} if known.created else {}
    return digests.canonical(
        {
            "_type": STATEMENT,
            "subject": [subject],
            "predicateType": PREDICATE,
            "predicate": {
                "buildDefinition": {
                    "buildType": BUILD,
                    "externalParameters": {
                        "targets": contents.targets(),
                        "recipes": dict(contents.recipes),
                        "request": dict(known.request),
                    },
                    "internalParameters": meaning,
                    "resolvedDependencies": list(_dependencies(contents, read)),
                },
                "runDetails": {
                    "builder": {"id": BUILDER, "version": {"dxb": contents.dxb}},
                    "metadata": metadata,
                },
            },
        }
    )


def subject_of(data: bytes) -> tuple[str, dict[str, Any]]:
    """(digest of the manifest, the statement) of an untrusted statement.

    Raises:
        BundleRefused: It is none, or of another kind.
    """
    what = "the provenance"
    raw = documents.parse(data, what)
    if raw.get("_type") != STATEMENT or raw.get("predicateType") != PREDICATE:
        raise ill_formed(what, "it is no in-toto statement with an SLSA provenance")
    subjects = documents.Reader(raw, what).items("subject")
    if len(subjects) != 1:
        raise ill_formed(what, "it is not about one thing")
    digest = documents.Reader(documents.Reader(subjects[0], what).raw.get("digest"), what).text("sha256")
    if not is_digest(digest):
        raise ill_formed(what, "`sha256` is not a SHA-256 digest")
    return digest, raw


def _dependencies(contents: Contents, read: Callable[[str], bytes]) -> Iterator[dict[str, Any]]:
    """Recipes, project files, rule code and packages, without duplicates and sorted."""
    found: dict[tuple[str, str, str], None] = {}
    for address, digest in contents.recipes.items():
        found["recipe", address, digest] = None
    for _, node in contents.nodes():
        document = json.loads(read(node.key))
        rule = document["rule"] + (f":{document['backend']}" if document["backend"] else "")
        found["rule", rule, digests.of_value(document["code"])] = None
        for name, version in document["packages"].items():
            found["package", name, version] = None
        for weight in document["weights"]:
            name, _, digest = weight.partition("@")
            found["weights", name, digest] = None
        found.update(dict.fromkeys(_files(node, document, read)))
    for kind, name, value in sorted(found):
        yield _resource(kind, name, value)


def _files(node: Node, document: Mapping[str, Any], read: Callable[[str], bytes]) -> Iterator[tuple[str, str, str]]:
    inputs = dict(document["inputs"])
    for slot, path in node.files.items():
        digest = inputs.get(slot)
        if digest is None:
            name, _, label = slot.partition("[")
            items = headers.items(read, inputs[name])
            digest = items[label.removesuffix("]")]
        for inner, blob in _content(json.loads(read(digest))).items():
            yield "file", f"{path}/{inner}" if inner else path, blob


def _content(leaf: Mapping[str, Any]) -> dict[str, str]:
    """Name -> digest of the files of a `File` or `Folder`."""
    if leaf["artifact"] == "File":
        return {"": leaf["fields"]["data"]["$bytes"][0]}
    return {name: value["$bytes"][0] for name, value in leaf["fields"]["files"]["$map"].items()}


def _resource(kind: str, name: str, value: str) -> dict[str, Any]:
    if kind == "package":
        return {"name": name, "uri": f"pkg:pypi/{name.lower().replace('_', '-')}@{value}"}
    found: dict[str, Any] = {"name": name, "annotations": {"kind": kind}}
    if is_digest(value):
        return found | {"digest": {"sha256": value}}
    return found | {"uri": f"urn:dextera:{kind}:{name}@{value}"}
