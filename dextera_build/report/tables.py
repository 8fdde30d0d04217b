"""`Table` artifacts and check reports, from their headers."""

from __future__ import annotations

from typing import Any

from dextera_build.report.html import Child, Html, tag
from dextera_build.report.run import Node, Run
from dextera_build.report.sources import plain
from dextera_build.report.wording import number, percent

_ARROWS = {"higher": ("↑", "higher is better"), "lower": ("↓", "lower is better")}
_UNITS = {"m": "m", "rad": "rad", "kg": "kg", "s": "s", "j": "J", "n": "N", "px": "px"}


def tables(run: Run) -> list[Html]:
    """Every table among the outputs, then the rows of check reports."""
    found = [_table(node, plain(node.fields)) for node in run.nodes if node.artifact == "Table"]
    found += [_records(node, name, rows) for node in run.nodes for name, rows in records(node)]
    return [table for table in found if table]


def passed(node: Node) -> bool | None:
    """The verdict of a check report; None for other artifacts."""
    value = node.fields.get("passed")
    return value if isinstance(value, bool) else None


def records(node: Node) -> list[tuple[str, list[dict[str, Any]]]]:
    """Lists of like rows in a check report: (field, rows)."""
    if passed(node) is None:
        return []
    found = []
    for name, value in plain(node.fields).items():
        if (
            isinstance(value, list)
            and value
            and all(isinstance(v, dict) and v.keys() == value[0].keys() for v in value)
        ):
            found.append((name, value))
    return found


def _table(node: Node, fields: dict[str, Any]) -> Html:
    columns = [column for column in fields.get("columns", []) if isinstance(column, dict)]
    rows = [row for row in fields.get("rows", []) if isinstance(row, list)]
    notes = [str(note) for note in fields.get("notes", [])]
    numeric = [any(_is_number(row[i]) for row in rows if i < len(row)) for i in range(len(columns))]
    head = [_heading(column, right) for column, right in zip(columns, numeric, strict=True)]
    body = [
        tag("tr", None, [_cell(v, c, right) for v, c, right in zip(row, columns, numeric, strict=False)])
        for row in rows
    ]
    return _frame(str(fields.get("title", "")), node, head, body, notes)


def _records(node: Node, name: str, rows: list[dict[str, Any]]) -> Html:
    # Headers are sorted by name; a row is identified by its text.
    keys = sorted(rows[0], key=lambda key: not isinstance(rows[0][key], str))
    columns = [_column(key) for key in keys]
    numeric = [any(_is_number(row[key]) for row in rows) for key in keys]
    head = [_heading(column, right) for column, right in zip(columns, numeric, strict=True)]
    body = [
        tag("tr", None, [_cell(row[k], c, right) for k, c, right in zip(keys, columns, numeric, strict=True)])
        for row in rows
    ]
    holds = bool(passed(node))
    verdict = tag("span", {"class": "yes" if holds else "no"}, "✓ passed" if holds else "✗ did not pass")
    return _frame([f"{node.name}: {name} ", verdict], node, head, body, [])


def _frame(title: Child, node: Node, head: list[Html], body: list[Html], notes: list[str]) -> Html:
    source = tag("a", {"href": f"#n{node.index}", "data-node": node.index, "class": "source"}, node.address)
    table = tag(
        "table",
        None,
        tag("caption", None, tag("b", None, title), " ", source),
        tag("thead", None, tag("tr", None, head)),
        tag("tbody", None, body),
    )
    remarks = tag("ul", {"class": "notes"}, [tag("li", None, note) for note in notes]) if notes else None
    return tag("div", {"class": "card"}, tag("div", {"class": "scroll", "tabindex": "0"}, table), remarks)


def _heading(column: dict[str, Any], right: bool) -> Html:
    sign, words = _ARROWS.get(str(column.get("better", "")), ("", ""))
    arrow = tag("span", {"class": "better", "title": words, "aria-label": words, "role": "img"}, sign) if sign else None
    unit = tag("span", {"class": "unit"}, f" [{column['unit']}]") if column.get("unit") else None
    return tag("th", {"scope": "col", "class": "number" if right else None}, str(column.get("name", "")), unit, arrow)


def _cell(value: Any, column: dict[str, Any], right: bool) -> Html:
    kind = "number" if right else None
    if value is None:
        return tag("td", {"class": kind}, "–")
    if isinstance(value, bool):
        return tag("td", {"class": "yes" if value else "no"}, "✓ yes" if value else "✗ no")
    if isinstance(value, float):
        digits = column.get("digits")
        return tag("td", {"class": kind}, _written(value, str(column.get("unit", "")), digits))
    if isinstance(value, int):
        return tag("td", {"class": kind}, f"{value:,}")
    return tag("td", {"class": kind}, str(value))


def _written(value: float, unit: str, digits: Any) -> str:
    if isinstance(digits, int):
        return f"{value:,.{digits}f}"
    return percent(value) if unit.startswith("%") else number(value)


def _column(key: str) -> dict[str, Any]:
    """Heading and unit from a field's name: `drift_m` is `drift [m]`."""
    stem, _, unit = key.rpartition("_")
    if stem and unit in _UNITS:
        return {"name": stem.replace("_", " "), "unit": _UNITS[unit]}
    return {"name": key.replace("_", " ")}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
