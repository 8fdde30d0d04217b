"""Recorded calls, as shown by `dxb ls calls`, `dxb show CALL` and the lineage of a node."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from typing import Any

from dextera_build.errors import UsageError
from dextera_build.project.project import Project
from dextera_build.session import reading
from dextera_build.store.blobs import listing
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store

_DIGEST = re.compile(r"[0-9a-f]{8,64}")
_MOST_SHOWN = 2000
"""Maximum length of an answer [characters]."""


def is_call(text: str) -> bool:
    """Whether an operand is a digest or a digest prefix, rather than a recipe."""
    return _DIGEST.fullmatch(text) is not None


def rows(project: Project) -> Iterator[dict[str, Any]]:
    """Every recorded call of the store, newest first."""
    found = [(key, *known) for key, known in _all(reading(project))]
    for key, document, result in sorted(found, key=lambda row: -_amount(row[2], "asked")):
        yield {
            "call": key,
            "service": document["service"],
            "model": _model(document),
            "asked": time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(_amount(result, "asked"))),
            "seconds": result.seconds,
            "tokens": _amount(result, "total_tokens"),
            "cost": _amount(result, "cost"),
            "answer": int(_amount(result, "answer")),
        }


def cells(row: dict[str, Any]) -> dict[str, str]:
    """A row as text: short digest, amounts with units."""
    amounts = {"seconds": f"{row['seconds']:.1f} s", "answer": f"{row['answer']} bytes"}
    tokens = {"tokens": f"{row['tokens']:g}", "cost": f"{row['cost']:g}"}
    return {name: str(value) for name, value in (row | {"call": row["call"][:12]} | amounts | tokens).items()}


def show(project: Project, text: str) -> dict[str, Any]:
    """Request, answer and amounts of the call whose digest begins with `text`.

    Raises:
        UsageError: No call matches, or more than one.
    """
    from dextera_build.calls import recorder

    store = reading(project)
    keys = [key for key, _, _ in listing(store.actions.root) if key.startswith(text)]
    found = [(key, known) for key in keys if (known := recorder.of(store, key))]
    if len(found) != 1:
        many = f"{len(found)} recorded calls begin with" if found else "no recorded call begins with"
        raise UsageError(f"{many} `{text}`", code="DXB-U183", hint="`dxb ls calls --json` has the whole digests")
    key, (document, result) = found[0]
    body = recorder.body_of(store, result).decode(errors="replace")
    said = {name: f"{value:g} {unit}".strip() for name, (value, unit) in result.metrics.items() if name != "asked"}
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(_amount(result, "asked")))
    asked = {f"request.{name}": json.dumps(value, ensure_ascii=False) for name, value in document["request"].items()}
    head = {"call": key, "service": document["service"], "asked": when, "seconds": f"{result.seconds:.3f}"}
    short = body if len(body) <= _MOST_SHOWN else f"{body[: _MOST_SHOWN - 3]}..."
    return {**head, **said, **asked, "output": result.output, "said": " ".join(short.split())}


def of_result(store: Store, result: ActionResult) -> list[dict[str, Any]]:
    """The recorded calls behind a node's result."""
    from dextera_build.calls import recorder

    found = []
    for key, _ in result.calls:
        known = recorder.of(store, key)
        about = {"service": known[0]["service"], "model": _model(known[0])} if known else {}
        found.append({"call": key, **about})
    return found


def _all(store: Store) -> Iterator[tuple[str, tuple[Any, ActionResult]]]:
    from dextera_build.calls import recorder

    for key, _, _ in listing(store.actions.root):
        result = store.actions.known(key)
        # Other entries are skipped early: a store holds many more nodes than calls.
        if result is not None and result.line.startswith("call ") and (known := recorder.of(store, key)):
            yield key, known


def _model(document: Any) -> str:
    request = document["request"]
    return str(request.get("model") or "-") if isinstance(request, dict) else "-"


def _amount(result: ActionResult, name: str) -> float:
    return result.metrics.get(name, (0.0, ""))[0]
