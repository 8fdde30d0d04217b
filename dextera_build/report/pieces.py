"""Small pieces that several sections show: states, metrics, errors, sections."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from dextera_build.report.html import Child, Html, tag
from dextera_build.report.run import Node
from dextera_build.report.wording import MARKS, duration, quantity

_LITERAL = re.compile(r"`([^`]+)`")


def section(name: str, title: str, *children: Child) -> Html:
    """A part of the page with its heading; `name` is the anchor."""
    heading = tag("h2", {"id": f"{name}-title"}, title)
    return tag("section", {"id": name, "aria-labelledby": f"{name}-title"}, heading, children)


def state(node: Node) -> Html:
    """Mark and word: `+ ran`."""
    mark = tag("span", {"class": "mark", "aria-hidden": "true"}, MARKS.get(node.status, "?"))
    return tag("span", {"class": f"state {node.status}"}, mark, " ", node.status)


def link(node: Node, text: str = "") -> Html:
    """A link to the node's details."""
    return tag("a", {"href": f"#n{node.index}", "data-node": node.index}, text or node.address)


def took(node: Node) -> str:
    """Its time in this run, or in the run that built it."""
    if node.worked:
        return duration(node.seconds)
    if node.status == "cached" and node.first_seconds:
        return f"saved {duration(node.first_seconds)}"
    return ""


def metrics(found: Mapping[str, tuple[float, str]]) -> Html | None:
    """Numbers with their units."""
    if not found:
        return None
    pairs = [
        tag("div", None, tag("dt", None, name.replace("_", " ")), tag("dd", None, quantity(value, unit)))
        for name, (value, unit) in found.items()
    ]
    return tag("dl", {"class": "metrics"}, pairs)


def prose(text: str) -> list[Child]:
    """A message with its `literals` set as code."""
    return [tag("code", None, part) if i % 2 else part for i, part in enumerate(_LITERAL.split(text))]


def failure(error: Mapping[str, Any]) -> Html:
    """An error with its facts and its hint."""
    facts = error.get("facts") if isinstance(error.get("facts"), Mapping) else {}
    where = error.get("where")
    rows = [("at", ":".join(str(part) for part in where if part))] if isinstance(where, list) else []
    rows += [(str(name), str(value)) for name, value in (facts or {}).items()]
    listed = [tag("div", None, tag("dt", None, name), tag("dd", None, value)) for name, value in rows]
    hint = error.get("hint")
    return tag(
        "div",
        {"class": "failure"},
        tag(
            "p",
            None,
            tag("b", {"class": "code"}, str(error.get("code", "error"))),
            " ",
            prose(str(error.get("message", ""))),
        ),
        tag("dl", {"class": "facts"}, listed) if listed else None,
        tag("p", None, tag("b", None, "hint: "), prose(str(hint))) if hint else None,
    )
