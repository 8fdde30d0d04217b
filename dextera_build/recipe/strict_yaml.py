"""YAML 1.2 core scalars with positions: duplicate keys, merge keys and tags are refused, `no` is a string."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import yaml

from dextera_build.errors import Place, RecipeError

PARSER: Any = yaml.SafeLoader
"""libyaml's parser if PyYAML was built with it."""
if yaml.__with_libyaml__:
    from yaml import cyaml

    PARSER = cyaml.CLoader

_FORMS: tuple[tuple[re.Pattern[str], Callable[[str], object]], ...] = (
    (re.compile(r"~|null|Null|NULL|"), lambda text: None),
    (re.compile(r"true|True|TRUE|false|False|FALSE"), lambda text: text.lower() == "true"),
    (re.compile(r"[-+]?[0-9]+"), int),
    (re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+"), lambda text: int(text, 0)),
    (re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"), float),
)
"""Patterns of plain scalars that are not text, and their conversions."""
_STARTS = frozenset(("", *"~nNtTfF-+.0123456789"))
"""First characters of these scalars."""
_DEEPEST = 100
_MOST_ALIASED = 100_000
"""Limit on values that aliases expand to in one file: a few lines can expand to a billion."""
_MOST_DIGITS = 400
"""Limit on digits of a number; no float needs more, and parsing takes time quadratic in the length."""
_MOST_REREAD = 1 << 20
"""Maximum length [characters] of an invalid text to parse again with the slower parser, for a better message."""


@dataclass(slots=True, repr=False)
class Node:
    """One YAML value with its place; a mapping holds `dict[str, Node]`, a sequence `list[Node]`."""

    value: Any
    place: Place
    keys: Mapping[str, Place] = field(default_factory=dict)
    """Place of each key of a mapping."""

    def entries(self) -> Iterator[tuple[str, Place, Node]]:
        """Yield key, place of the key, and value of each entry of a mapping."""
        for name, inner in self.value.items():
            yield name, self.keys[name], inner

    @property
    def kind(self) -> str:
        """`mapping`, `list`, `text`, `number`, `true/false` or `nothing`."""
        names = {dict: "mapping", list: "list", str: "text", bool: "true/false", type(None): "nothing"}
        return names.get(type(self.value), "number")

    def plain(self) -> Any:
        """The value without places."""
        value = self.value
        if isinstance(value, dict):
            return {name: inner.plain() for name, inner in value.items()}
        return [inner.plain() for inner in value] if isinstance(value, list) else value

    def map(self, change: Callable[[Node], Node]) -> Node:
        """The same value with `change` applied to every scalar in it."""
        if isinstance(self.value, dict):
            return replace(self, value={name: inner.map(change) for name, inner in self.value.items()})
        if isinstance(self.value, list):
            return replace(self, value=[inner.map(change) for inner in self.value])
        return change(self)

    def key(self, path: tuple[object, ...]) -> Place:
        """The place of the last key of `path`, or of its value if the key has none."""
        return self._below(path[:-1]).keys.get(str(path[-1])) or self.at(path)

    def at(self, path: tuple[object, ...]) -> Place:
        """The place of the value below `path` of keys and indices, or of the deepest part that exists."""
        return self._below(path).place

    def _below(self, path: tuple[object, ...]) -> Node:
        node = self
        for step in path:
            value = node.value
            parts = dict(enumerate(value)) if isinstance(value, list) else value
            if not isinstance(parts, dict) or step not in parts:
                break
            node = parts[step]
        return node


def parse(text: str, file: str, place: Place | None = None) -> Node:
    """Parse one document.

    Args:
        text: YAML.
        file: Name for messages.
        place: Place of all values; None for their own places in the file.

    Raises:
        RecipeError: A syntax error, a duplicate key, a tag, a merge key, too many aliases or several documents.
    """
    try:
        return _Reader(PARSER(text), file, place).document()
    except yaml.YAMLError as error:
        raise _syntax_error(error, text, file) from None


class _Reader:
    """Converts parser events to nodes."""

    def __init__(self, parser: Any, file: str, place: Place | None = None) -> None:
        self._next = parser.get_event
        self._file = file
        self._fixed = place
        self._anchors: dict[str, tuple[Node, int, int]] = {}
        """Anchor -> node, number of values in it, number of levels."""
        self._values = self._aliased = 0

    def document(self) -> Node:
        """The node of the one document."""
        self._next()
        if isinstance(self._next(), yaml.StreamEndEvent):
            raise RecipeError("the file is empty", code="DXB-R101", where=Place(self._file))
        root, _ = self._node(self._next(), 0)
        self._next()
        event = self._next()
        if not isinstance(event, yaml.StreamEndEvent):
            raise yaml.MarkedYAMLError(problem="but found another document", problem_mark=event.start_mark)
        return root

    def _node(self, event: Any, depth: int) -> tuple[Node, int]:
        """The value that starts with `event`, `depth` levels deep, and its number of nested levels."""
        place = self._place(event)
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, depth, place)
        before, levels = self._values, 0
        self._values += 1
        if isinstance(event, yaml.ScalarEvent):
            node = Node(self._scalar(event, place), place)
        else:
            _refuse_tag(event, place)
            _refuse_deep(depth + 1, place)
            holds = self._mapping if isinstance(event, yaml.MappingStartEvent) else self._sequence
            node, levels = holds(depth + 1, place)
        if event.anchor is not None:
            self._anchors[event.anchor] = (node, self._values - before, levels)
        return node, levels

    def _mapping(self, depth: int, place: Place) -> tuple[Node, int]:
        values: dict[str, Node] = {}
        keys: dict[str, Place] = {}
        levels = 0
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            here = self._place(event)
            key = self._key(event, here, keys)
            keys[key] = here
            values[key], below = self._node(self._next(), depth)
            levels = max(levels, below)
        return Node(values, place, keys), levels + 1

    def _sequence(self, depth: int, place: Place) -> tuple[Node, int]:
        values: list[Node] = []
        levels = 0
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            node, below = self._node(event, depth)
            values.append(node)
            levels = max(levels, below)
        return Node(values, place), levels + 1

    def _key(self, event: Any, place: Place, known: Mapping[str, Place]) -> str:
        key = self._scalar(event, place) if isinstance(event, yaml.ScalarEvent) else None
        if key == "<<":
            hint = "write the fields out, or give nodes that differ in a few of them `each:`"
            raise RecipeError("recipes have no merge keys, `<<`", code="DXB-R102", where=place, hint=hint)
        if not isinstance(key, str):
            shown = "none" if key is None else repr(key)
            raise RecipeError(f"a key must be text, this one is {shown}", code="DXB-R102", where=place)
        if key in known:
            raise RecipeError(
                f"`{key}` is a duplicate key",
                code="DXB-R103",
                where=place,
                facts={"first": known[key]},
            )
        return sys.intern(key)

    @staticmethod
    def _scalar(event: Any, place: Place) -> Any:
        _refuse_tag(event, place)
        return _plain(event.value, place) if event.implicit[0] else event.value

    def _alias(self, event: Any, depth: int, place: Place) -> tuple[Node, int]:
        if event.anchor not in self._anchors:
            raise yaml.MarkedYAMLError(problem=f"found undefined alias {event.anchor!r}", problem_mark=event.start_mark)
        node, values, levels = self._anchors[event.anchor]
        _refuse_deep(depth + levels, place)
        self._values += values
        self._aliased += values
        if self._aliased > _MOST_ALIASED:
            raise RecipeError(
                f"aliases expand to more than {_MOST_ALIASED} values",
                code="DXB-R101",
                where=place,
                hint="write the values down, or use a recipe within a recipe",
            )
        return node, levels

    def _place(self, event: Any) -> Place:
        mark = event.start_mark
        return self._fixed or Place(self._file, mark.line + 1, mark.column + 1)


def _refuse_deep(depth: int, place: Place) -> None:
    if depth > _DEEPEST:
        raise RecipeError(f"values are nested more than {_DEEPEST} deep", code="DXB-R101", where=place)


def _refuse_tag(event: Any, place: Place) -> None:
    if event.tag is not None:
        raise RecipeError(f"the tag `{event.tag}` is not known here", code="DXB-R102", where=place)


def _plain(text: str, place: Place) -> Any:
    if text[:1] not in _STARTS:
        return text
    for form, value in _FORMS:
        if form.fullmatch(text):
            if len(text) > _MOST_DIGITS:
                message = f"a number has more than {_MOST_DIGITS} digits"
                raise RecipeError(message, code="DXB-R102", where=place, hint="quote it if it is text")
            return value(text)
    return text


def _syntax_error(error: yaml.YAMLError, text: str, file: str) -> RecipeError:
    if PARSER is not yaml.SafeLoader and len(text) <= _MOST_REREAD:
        # The Python parser has better error messages than libyaml.
        try:
            _Reader(yaml.SafeLoader(text), file).document()
        except yaml.YAMLError as better:
            error = better
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position]
        where = Place(file, before.count("\n") + 1, len(before) - before.rfind("\n"))
        code = f"U+{ord(text[error.position]):04X}"
        return RecipeError(f"not valid YAML: the character {code} is not allowed", code="DXB-R101", where=where)
    mark = getattr(error, "problem_mark", None)
    where = Place(file, mark.line + 1, mark.column + 1) if mark else Place(file)
    problem = getattr(error, "problem", None) or str(error)
    return RecipeError(f"not valid YAML: {problem}", code="DXB-R101", where=where)
