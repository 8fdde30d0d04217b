"""Changes of single elements in the text of a `scene.yaml`; everything else that people wrote into it stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from dextera_build.errors import Place, UsageError

Fields = Mapping[str, Any]
"""Field of an element -> its value; None removes the field."""


def changed(text: str, name: str, fields: Fields) -> str:
    """The text with fields of an element set or removed.

    Raises:
        UsageError: The file has no such element, or is written so that the change cannot be made in place.
    """
    wanted = _elements(text)
    _find(wanted, name).update(fields)
    for key, value in fields.items():
        text = _with(text, name, key, value)
    return _checked(text, [{key: value for key, value in each.items() if value is not None} for each in wanted])


def removed(text: str, name: str) -> str:
    """The text without an element, and without the comments inside it; errors as with `changed`."""
    wanted = _elements(text)
    wanted.remove(_find(wanted, name))
    sequence, entry = _entry(text, name)
    start, end = entry.start_mark.index, _end(text, entry)
    if sequence.flow_style:
        after = text[end:]
        comma = len(after) - len(after.lstrip()) if after.lstrip().startswith(",") else -1
        text = text[:start] + after[comma + 1 :].lstrip() if comma >= 0 else text[:start].rstrip(" ,\n") + after
    else:
        text = text[: text.rfind("\n", 0, start) + 1] + text[_behind(text, end, sequence.start_mark.column) :]
    return _checked(text, wanted)


def added(text: str, after: str, fields: Fields) -> str:
    """The text with another element behind the element `after`; errors as with `changed`."""
    wanted = _elements(text)
    wanted.insert(wanted.index(_find(wanted, after)) + 1, dict(fields))
    sequence, entry = _entry(text, after)
    end = _end(text, entry)
    if sequence.flow_style:
        made = "{" + ", ".join(f"{key}: {value}" for key, value in fields.items()) + "}"
        return _checked(f"{text[:end]}, {made}{text[end:]}", wanted)
    at, column = _behind(text, end, sequence.start_mark.column), sequence.start_mark.column
    lines = [f"{' ' * (column + 2)}{key}: {value}" for key, value in fields.items()]
    lines[0] = f"{' ' * column}- {lines[0].lstrip()}"
    before = text[:at] if text[:at].endswith("\n") else f"{text[:at]}\n"
    return _checked(before + "\n".join(lines) + "\n" + text[at:], wanted)


def line_of(text: str, name: str, key: str) -> int:
    """The line of a field, from 1."""
    return next(int(at.start_mark.line) + 1 for at, _ in _entry(text, name)[1].value if at.value == key)


def names(text: str) -> Sequence[str]:
    """The names of the elements."""
    return [str(each.get("name")) for each in _elements(text)]


def _with(text: str, name: str, key: str, value: Any) -> str:
    entry = _entry(text, name)[1]
    old = next(((at, node) for at, node in entry.value if at.value == key), None)
    if old is None and value is None:
        return text
    if old is not None and value is not None:
        return f"{text[: old[1].start_mark.index]}{value}{text[_end(text, old[1]) :]}"
    if old is not None:
        return _without(text, old[0].start_mark.index, _end(text, old[1]), flow=bool(entry.flow_style))
    named = next(_end(text, node) for at, node in entry.value if at.value == "name")
    if entry.flow_style:
        return f"{text[:named]}, {key}: {value}{text[named:]}"
    line = text.find("\n", named)
    line = len(text) if line < 0 else line
    return f"{text[:line]}\n{' ' * entry.start_mark.column}{key}: {value}{text[line:]}"


def _without(text: str, start: int, end: int, *, flow: bool) -> str:
    if flow:
        return text[:start].rstrip().removesuffix(",") + text[end:]
    line = text.find("\n", end)
    return text[: text.rfind("\n", 0, start) + 1] + ("" if line < 0 else text[line + 1 :])


def _behind(text: str, end: int, column: int) -> int:
    """Where the line after an entry begins, and after the comments that are indented deeper than `column`."""
    at = text.find("\n", end) + 1 or len(text)
    while at < len(text):
        line, rest, _ = text[at:].partition("\n")
        inner = line.lstrip()
        if not inner.startswith("#") or len(line) - len(inner) <= column:
            return at
        at += len(line) + len(rest)
    return at


def _end(text: str, node: Any) -> int:
    """Where a node ends: YAML counts what follows a block to it."""
    if node.id == "scalar" or node.flow_style:
        return int(node.end_mark.index)
    inner = [part for pair in node.value for part in (pair if isinstance(pair, tuple) else (pair,))]
    return _end(text, inner[-1])


def _entry(text: str, name: str) -> tuple[Any, Any]:
    """The nodes of the list, and of the element."""
    root: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    sequence = next(value for key, value in root.value if key.value == "elements")
    for entry in sequence.value:
        if any(key.value == "name" and value.value == name for key, value in entry.value):
            return sequence, entry
    raise AssertionError(name)


def _elements(text: str) -> list[dict[str, Any]]:
    try:
        root = yaml.safe_load(text)
        return [dict(each) for each in root["elements"]]
    except (yaml.YAMLError, TypeError, KeyError, ValueError) as error:
        place = getattr(error, "problem_mark", None)
        raise UsageError(
            "the file does not list elements",
            code="DXB-U221",
            where=Place("scene.yaml", place.line + 1) if place else None,
            hint="`dxb new scene RECIPE -o FILE` writes one",
        ) from None


def _find(elements: Sequence[dict[str, Any]], name: str) -> dict[str, Any]:
    found = next((each for each in elements if each.get("name") == name), None)
    if found is None:
        raise UsageError(
            f"the file lists no `{name}`",
            code="DXB-U221",
            facts={"elements": ", ".join(str(each.get("name")) for each in elements)},
            hint="build with the file, and open the view again",
        )
    return found


def _checked(text: str, wanted: Sequence[Fields]) -> str:
    """The text, if it says what is wanted: whatever the file's style is, nothing else may have changed."""
    try:
        fits = _elements(text) == list(wanted)
    except UsageError:
        fits = False
    if not fits:
        raise UsageError(
            "the file is written in a way that dxb cannot change in place",
            code="DXB-U222",
            hint="write each element as `- name: NAME` with its fields below it, as `dxb new scene` does",
        )
    return text
