"""Recorded calls, as shown by `dxb ls calls`, `dxb show CALL` and the lineage of a node."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from dextera_build.errors import UsageError
from dextera_build.project.project import Project
from dextera_build.report.wording import moment
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
    for key, document, result in sorted(found, key=lambda row: -(_amount(row[2], "asked") or 0.0)):
        yield {
            "call": key,
            "service": document["service"],
            "model": _model(document),
            "time": _amount(result, "asked"),
            "seconds": result.seconds,
            "tokens": _amount(result, "total_tokens"),
            "cost": _amount(result, "cost"),
            "answer_bytes": None if (size := _amount(result, "answer")) is None else int(size),
        }


def cells(row: dict[str, Any]) -> dict[str, str]:
    """A row as text: short digest, amounts with units."""
    answer, tokens, cost = row["answer_bytes"], row["tokens"], row["cost"]
    return {
        "call": row["call"][:12],
        "service": row["service"],
        "model": row["model"] or "-",
        "asked": moment(row["time"]),
        "seconds": f"{row['seconds']:.1f} s",
        "tokens": "-" if tokens is None else f"{tokens:g}",
        "cost": "-" if cost is None else f"{cost:g}",
        "answer": "-" if answer is None else f"{answer} bytes",
    }


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
    return {
        "call": key,
        "service": document["service"],
        "time": _amount(result, "asked"),
        "seconds": result.seconds,
        "metrics": {
            name: {"value": value, "unit": unit} for name, (value, unit) in result.metrics.items() if name != "asked"
        },
        "request": document["request"],
        "output": result.output,
        "answer": recorder.body_of(store, result).decode(errors="replace"),
    }


def shown(found: dict[str, Any]) -> dict[str, str]:
    """What `show` found as name and text."""
    said = {name: f"{each['value']:g} {each['unit']}".strip() for name, each in found["metrics"].items()}
    asked = {f"request.{name}": json.dumps(value, ensure_ascii=False) for name, value in found["request"].items()}
    head = {"call": found["call"], "service": found["service"], "asked": moment(found["time"])}
    body = found["answer"]
    short = body if len(body) <= _MOST_SHOWN else f"{body[: _MOST_SHOWN - 3]}..."
    own = {"seconds": f"{found['seconds']:.3f}", **said, **asked, "output": found["output"]}
    return {**head, **own, "said": " ".join(short.split())}


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


def _model(document: Any) -> str | None:
    request = document["request"]
    return str(request["model"]) if isinstance(request, dict) and request.get("model") else None


def _amount(result: ActionResult, name: str) -> float | None:
    return result.metrics[name][0] if name in result.metrics else None
