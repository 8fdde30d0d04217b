"""What `dxb show` tells of a node or of a part of its result, as data and as text."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.core.identity import parse
from dextera_build.building import part
from dextera_build.explain import origins, stubs
from dextera_build.explain.reads import Reads
from dextera_build.report.wording import STUB, used

if TYPE_CHECKING:
    from dextera_build.session import Session

_MOST = 100
"""Maximum length of a field's value as text [characters]."""


def node(session: Session, name: str) -> dict[str, Any]:
    """The document `show.node`."""
    entry = session.past(name)
    found, document = session.store.actions.find(entry.key), session.document(name)
    known = found.result if found else None
    return {
        "node": f"{session.recipe}:{name}",
        "result": line(session, entry.key)["line"],
        "rule": document["rule"],
        "version": document["version"],
        "backend": document["backend"],
        "run": entry.run or None,
        "time": entry.time,
        "seconds": entry.seconds,
        "key": entry.key,
        "stub": stubs.told(session, name) or None,
        "usage": dict(entry.usage),
        "output": known.output if known else None,
        "whole": bool(found and found.is_whole),
        "calls": [key for key, _ in known.calls] if known else [],
        "metrics": {each: {"value": value, "unit": unit} for each, (value, unit) in known.metrics.items()}
        if known
        else {},
        **(_header(session, known.output) if known else {"type": None, "fields": {}}),
        "options": document["options"],
        "inputs": dict(document["inputs"]),
        "reads": Reads(session).rows(document),
        "packages": document["packages"],
    }


def node_text(found: Mapping[str, Any]) -> dict[str, str]:
    """The same as name and text."""
    when = f"run {found['run']}, {time.strftime('%Y-%m-%d %H:%M', time.localtime(found['time']))}"
    since = when if found["run"] else "a build of another recipe"
    rows = {
        "node": found["node"],
        "result": line_text(found["result"], is_stub=found["backend"] == STUB),
        "rule": f"{found['rule']} version {found['version']}",
        "backend": found["backend"] or "-",
        "known since": f"{since}; it took {found['seconds']:.1f} s to make",
        "key": found["key"],
    }
    rows |= {"stub": found["stub"]} if found["stub"] else {}
    rows |= {"used": used(found["usage"])} if found["usage"] else {}
    if found["output"] is not None:
        rows["output"] = found["output"]
        rows |= {} if found["whole"] else {"bytes": "not in the store"}
    rows |= {f"call {number}": key for number, key in enumerate(found["calls"])}
    rows |= {f"metric {name}": f"{row['value']:g} {row['unit']}".strip() for name, row in found["metrics"].items()}
    rows |= _header_text(found)
    rows |= {f"option {name}": json.dumps(value) for name, value in found["options"].items()}
    rows |= {f"input {slot}": digest for slot, digest in found["inputs"].items()}
    rows |= {f"read {name}": told for name, told in found["reads"].items()}
    return rows | {f"package {name}": version for name, version in found["packages"].items()}


def part_of(session: Session, wanted: part.Part) -> dict[str, Any]:
    """The document `show.part`."""
    address = f"{session.recipe}:{wanted.node}"
    digest = part.digest_of(session, wanted)
    return {
        "part": ".".join([address, *wanted.fields]),
        "of": address,
        "result": ", ".join(part.artifact(session, wanted).facts()),
        "stub": stubs.told(session, wanted.node) or None,
        "digest": digest,
        **_header(session, digest),
    }


def part_text(found: Mapping[str, Any]) -> dict[str, str]:
    """The same as name and text."""
    rows = {name: found[name] for name in ("part", "of", "result", "stub", "digest") if found[name] is not None}
    return rows | _header_text(found)


def line(session: Session, key: str) -> dict[str, Any]:
    """`line`: the result of a key in one line, None if the store has lost it; `stub`: whether a stub made it."""
    found = session.store.actions.known(key)
    document = origins.document(session.store, key)
    return {"line": found.line if found else None, "stub": document is not None and document["backend"] == STUB}


def line_text(told: str | None, *, is_stub: bool) -> str:
    """The result in one line, with a mark for stubs."""
    if told is None:
        return "(no longer in the store)"
    return f"(stub) {told}" if is_stub else told


def _header(session: Session, output: str) -> dict[str, Any]:
    header = json.loads(session.store.blobs.get(output))
    fields = {name: _field(session, value) for name, value in header["fields"].items()}
    return {"type": header["artifact"], "fields": fields}


def _header_text(found: Mapping[str, Any]) -> dict[str, str]:
    rows = {"type": found["type"]} if found["type"] is not None else {}
    fields = {name: field["told"] for name, field in found["fields"].items()}
    if rows and parse(found["type"])[0] == "Table":
        del fields["columns"], fields["rows"]
        rows |= _table({name: field["value"] for name, field in found["fields"].items()})
    return rows | {f"field {name}": told for name, told in fields.items()}


def _table(fields: Mapping[str, Any]) -> dict[str, str]:
    """Headings and rows of a table."""
    columns = [each["$value"] for each in fields["columns"]]
    heads = [f"{each['name']} [{each['unit']}]" if each["unit"] else each["name"] for each in columns]
    rows = {"columns": ", ".join(heads)}
    for number, row in enumerate(fields["rows"], 1):
        cells = zip(row, columns, strict=True)
        told = [f"{cell:.{column['digits']}f}" if isinstance(cell, float) else str(cell) for cell, column in cells]
        rows[f"row {number}"] = ", ".join("-" if each == "None" else each for each in told)
    return rows


def _field(session: Session, value: Any) -> dict[str, Any]:
    """A field of a header: in a few words, and as data if it holds plain data or an array."""
    row: dict[str, Any] = {"told": "", "value": None, "dtype": None, "shape": None}
    if isinstance(value, dict) and "$array" in value:
        dtype, shape, _ = value["$array"]
        return row | {"told": f"{dtype} {tuple(shape)}", "dtype": dtype, "shape": shape}
    if isinstance(value, dict) and "$ref" in value and session.store.blobs.has(value["$ref"]):
        return row | {"told": _inner(json.loads(session.store.blobs.get(value["$ref"])))}
    if isinstance(value, dict) and "$map" in value:
        return row | {"told": ", ".join(value["$map"]) or "none"}
    if isinstance(value, dict) and "$value" not in value:
        return row | {"told": next(iter(value), "").removeprefix("$")}
    return row | {"told": _short(json.dumps(_rounded(value))), "value": None if isinstance(value, dict) else value}


def _rounded(value: Any) -> Any:
    """Plain data with six digits of each number, and twelve of each digest of a part."""
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    if isinstance(value, dict):
        inner = value.get("$value", value)
        told = inner.get("$ref", inner) if isinstance(inner, dict) else inner
        return told[:12] if isinstance(told, str) else {name: _rounded(each) for name, each in told.items()}
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _inner(header: dict[str, Any]) -> str:
    """`Pose, parent world, child object`: an artifact inside another one, without its arrays and parts."""
    plain = {name: value for name, value in header["fields"].items() if isinstance(value, str | int | float)}
    return _short(", ".join([header["artifact"], *(f"{name} {_rounded(value)}" for name, value in plain.items())]))


def _short(text: str) -> str:
    return text if len(text) < _MOST else f"{text[: _MOST - 3]}..."
