"""Reads artifact headers as plain JSON, without artifact types; `artifacts/base.py` describes the format."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from dextera_build import digest as digests
from dextera_build.errors import ArtifactError, RuleError, StoreError, did_you_mean, listing

Read = Callable[[str], bytes]
"""digest -> bytes."""


_PARTS: dict[str, list[type]] = {"$bytes": [str, int], "$array": [str, list, str]}
"""Tag -> types of the values after it."""

ESCAPES = "DXB-S219"
"""Code of the error for a label that leads out of its folder."""


@contextmanager
def reading(what: str) -> Iterator[None]:
    """Turn errors of the block, which decodes an untrusted header, into `ArtifactError`.

    Args:
        what: Names the artifact in the error.

    Raises:
        ArtifactError: The stored header does not match its type.
    """
    try:
        yield
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        why = f"{type(error).__name__}: {error}"
        raise ArtifactError(f"the stored header of {what} is malformed", code="DXB-A111", facts={"why": why}) from None


def closure(header: bytes) -> tuple[list[str], list[str]]:
    """Digests of the (artifacts, blobs) that one header refers to directly, in the order of the header.

    Raises:
        StoreError: A label would lead out of the folder that the artifact is written to.
        ValueError: The bytes are not a header.
    """
    refs: list[str] = []
    blobs: list[str] = []
    stack: list[Any] = [*reversed(_fields(digests.plain(header)).values())]
    while stack:
        value = stack.pop()
        if isinstance(value, list):
            stack += reversed(value)
        elif isinstance(value, dict):
            tag, body = value.popitem() if len(value) == 1 else ("", None)
            if type(body) is list and [*map(type, body)] == _PARTS.get(tag):
                blobs.append(body[0] if tag == "$bytes" else body[2])
            elif tag == "$ref" and type(body) is str:
                refs.append(body)
            elif tag in ("$map", "$value") and type(body) is dict:
                if tag == "$map":
                    _refuse_escapes(body)
                stack += reversed(body.values())
            else:
                raise ValueError("a value has a form that no header has")
    return refs, blobs


def _fields(stored: Any) -> dict[str, Any]:
    """The fields of a header, checked for `File` and `Folder`, which are read without decoding.

    Raises:
        ValueError: `stored` is not a header.
    """
    match stored:
        case {"artifact": "File", "fields": {"data": {"$bytes": _}, **more}}:
            right = not more
        case {"artifact": "Folder", "fields": {"files": {"$map": dict(files)}, **more}}:
            right = not more and all(isinstance(file, dict) and "$bytes" in file for file in files.values())
        case {"artifact": str(kind), "fields": dict()}:
            right = kind not in ("File", "Folder")
        case _:
            right = False
    if not right or len(stored) != 2:
        raise ValueError("it is not a header")
    fields: dict[str, Any] = stored["fields"]
    return fields


def project(read: Read, digest: str, fields: Sequence[str]) -> str:
    """Follow artifact fields from `digest`; a step may also be a key of a map of artifacts.

    Raises:
        RuleError: A field does not exist, is not set, or leads to something that is not an artifact.
    """
    found = project_set(read, digest, fields, unset=False)
    assert found is not None
    return found


def project_set(read: Read, digest: str, fields: Sequence[str], *, unset: bool = True) -> str | None:
    """Like `project`; with `unset`, None if a field on the way is declared but not set.

    Raises:
        RuleError: A field does not exist, or leads to something that is not an artifact.
    """
    kind = owner = ""
    here: Any = {"$ref": digest}
    for place, step in enumerate(fields):
        if "$ref" in here:
            header = json.loads(read(here["$ref"]))
            kind, known = header["artifact"], header["fields"]
            owner = f"a field of {kind}"
        else:
            known = here["$map"]
            owner = f"in `{fields[place - 1]}` of {kind}"
        here = known.get(step)
        last = place == len(fields) - 1
        if unset and here is None and step in known:
            return None
        if not isinstance(here, dict) or ("$ref" not in here and (last or "$map" not in here)):
            raise _refused(step, owner, known)
    return str(here["$ref"])


def items(read: Read, digest: str) -> dict[str, str]:
    """The map that `each` opens, label -> artifact, from the field `items`.

    Raises:
        RuleError: The artifact has no such field.
    """
    header = json.loads(read(digest))
    body = header["fields"].get("items")
    inner = body.get("$map") if isinstance(body, dict) else None
    if inner is None or not all(isinstance(item, dict) and "$ref" in item for item in inner.values()):
        raise RuleError(
            f"`each` cannot open {header['artifact']}: it has no field `items` that maps labels to artifacts",
            code="DXB-B313",
            facts={"fields": listing(header["fields"])},
        )
    return {label: item["$ref"] for label, item in inner.items()}


def file_header(blob: str, size: int) -> bytes:
    """The header of the `File` with this content."""
    return digests.canonical({"artifact": "File", "fields": {"data": {"$bytes": [blob, size]}}})


def folder_header(tree: Mapping[str, tuple[str, int]]) -> bytes:
    """The header of the `Folder` with these files: relative POSIX path -> (blob, size)."""
    content = {name: {"$bytes": [blob, size]} for name, (blob, size) in tree.items()}
    return digests.canonical({"artifact": "Folder", "fields": {"files": {"$map": content}}})


def collection_header(parts: Mapping[str, str]) -> bytes:
    """The header of the `Collection` of these artifacts: label -> digest."""
    items = {label: {"$ref": digest} for label, digest in parts.items()}
    return digests.canonical({"artifact": "Collection", "fields": {"items": {"$map": items}}})


def _refuse_escapes(labels: Iterable[str]) -> None:
    """Refuse labels that lead out of their folder: headers are untrusted, and labels become file names."""
    for label in labels:
        if label.startswith("/") or "\0" in label or (".." in label and ".." in label.split("/")):
            raise StoreError(f"label {label!a} leads out of the folder that it would be written to", code="DXB-S219")


def _leads_on(body: Mapping[str, Any]) -> bool:
    """Whether a field is a part of its own, or a map of such parts."""
    parts = body.get("$map")
    return "$ref" in body or (
        isinstance(parts, dict) and any("$ref" in each for each in parts.values() if type(each) is dict)
    )


def _refused(step: str, owner: str, known: Mapping[str, Any]) -> RuleError:
    reach = [name for name, body in known.items() if isinstance(body, dict) and _leads_on(body)]
    if step not in known:
        return RuleError(
            f"`{step}` is not {owner}",
            code="DXB-B311",
            facts={"known": listing(known)},
            hint=did_you_mean(step, known),
        )
    state = "is not set" if known[step] is None else "is not an artifact"
    return RuleError(f"`{step}`, {owner}, {state}", code="DXB-B312", facts={"artifacts": listing(reach)})
