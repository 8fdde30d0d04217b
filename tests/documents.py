"""Reads the JSON documents of verbs, and compares each with its description, field by field."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dextera_build.cli.documents import DOCUMENTS
from dextera_build.cli.documents.document import Document

_KINDS: Mapping[str, tuple[type, ...]] = {
    "text": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "object": (dict,),
    "list": (list,),
}
RECORD = Path(__file__).parent / "cli" / "documents.json"
"""Schema -> path of a field -> its type."""


def read(text: str) -> dict[str, Any]:
    """The document in `text`, which is all of it."""
    (found,) = every(text)
    return found


def rows(text: str) -> list[dict[str, Any]]:
    """The rows of the document in `text`."""
    found: list[dict[str, Any]] = read(text)["rows"]
    return found


def every(text: str) -> list[dict[str, Any]]:
    """The documents in `text`, one after the other."""
    found, decoder = [], json.JSONDecoder(parse_constant=_refused)
    rest = text.lstrip()
    while rest:
        plain, end = decoder.raw_decode(rest)
        found.append(compared(plain))
        rest = rest[end:].lstrip()
    return found


def compared(plain: Any) -> dict[str, Any]:
    """A document, after a comparison with its description."""
    assert isinstance(plain, dict)
    assert next(iter(plain)) == "schema"
    name = plain["schema"].removeprefix("dxb.").rpartition("/")[0]
    document = DOCUMENTS[name]
    assert plain["schema"] == document.schema
    wrong = differences(document, {key: value for key, value in plain.items() if key != "schema"})
    assert wrong == [], f"{document.schema}: {'; '.join(wrong)}"
    return plain


def differences(document: Document, plain: dict[str, Any]) -> list[str]:
    """What a document has that its description does not state, and the other way round."""
    found: list[str] = []
    _compare(document, "", plain, found)
    return found


def _compare(document: Document, path: str, value: Any, found: list[str]) -> None:
    kind = document.fields.get(path, ("", ""))[0].removesuffix("?")
    if value is None and (kind == "any" or kind.endswith(" or null")):
        return
    kind = kind.removesuffix(" or null")
    inside = [each for each in document.fields if each.startswith((f"{path}.", f"{path}[]")) or not path]
    if inside:
        kind = kind or ("list" if any(each.startswith(f"{path}[]") for each in inside) and path else "object")
    if kind != "any" and not _is(value, kind):
        found.append(f"`{path}` is {value!r}, not {kind}")
    elif isinstance(value, list) and inside:
        for item in value:
            _compare(document, f"{path}[]", item, found)
    elif isinstance(value, dict) and inside:
        _compare_fields(document, f"{path}." if path else "", value, found)


def _compare_fields(document: Document, before: str, value: dict[str, Any], found: list[str]) -> None:
    stated = {
        each.removeprefix(before).partition(".")[0].partition("[]")[0]: each
        for each in document.fields
        if each.startswith(before)
    }
    for name, inner in value.items():
        if name not in stated and "*" not in stated:
            found.append(f"`{before}{name}` is not described")
        else:
            _compare(document, f"{before}{name if name in stated else '*'}", inner, found)
    optional = {name for name, each in stated.items() if document.fields[each][0].endswith("?")}
    found += [f"`{before}{name}` is missing" for name in stated.keys() - value.keys() - optional - {"*"}]


def _is(value: Any, kind: str) -> bool:
    kind, _, items = kind.partition(" of ")
    if isinstance(value, bool) and kind != "boolean":
        return False
    return isinstance(value, _KINDS[kind]) and (not items or all(_is(item, items) for item in value))


def _refused(name: str) -> None:
    raise AssertionError(f"`{name}` is not JSON")


def described() -> dict[str, dict[str, str]]:
    """Schema -> path of a field -> its type, as the descriptions state them."""
    return {
        document.schema: {path: kind for path, (kind, _) in document.fields.items()} for document in DOCUMENTS.values()
    }


def recorded() -> dict[str, dict[str, str]]:
    """The same as it was recorded."""
    found: dict[str, dict[str, str]] = json.loads(RECORD.read_text())
    return found


if __name__ == "__main__":
    RECORD.write_text(json.dumps(described(), indent=1, sort_keys=True) + "\n")
