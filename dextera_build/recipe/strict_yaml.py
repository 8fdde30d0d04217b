"""YAML 1.2 core scalars with positions: duplicate keys, merge keys and tags are refused, `no` is a string."""

from __future__ import annotations

import re
import sys
from array import array
from collections.abc import Callable
from typing import Any

import yaml

from dextera_build.errors import Place, RecipeError
from dextera_build.recipe.yaml_node import Node as Node
from dextera_build.recipe.yaml_node import mark_of, place_of

PARSER: Any = yaml.SafeLoader
"""libyaml's, where PyYAML has it."""
if yaml.__with_libyaml__:
    from yaml import cyaml

    PARSER = cyaml.CLoader

_SCALARS: tuple[tuple[str, re.Pattern[str], str], ...] = (
    ("null", re.compile(r"^(?:~|null|Null|NULL|)$"), "~nN"),
    ("bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), "tTfF"),
    ("int", re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"), "-+0123456789"),
    ("float", re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$"), "-+.0123456789"),
)
"""Kind, form, and what such a scalar may begin with."""
_PLAIN = {
    first: [(kind, form) for kind, form, starts in _SCALARS if first in starts] for first in "~nNtTfF-+.0123456789"
}
_CORE = "tag:yaml.org,2002:"
_DEEPEST = 100
_NAMES_DEPTH = 2
"""Names of inputs and nodes are keys of mappings so deep."""
_MOST_ALIASED = 100_000
"""How many values aliases may stand for in one file: a few lines of them can say a billion."""
_MOST_DIGITS = 400
"""The largest number of the longest float has fewer; to read and write long ones takes the square of their length."""
_MOST_REREAD = 1 << 20
"""A text up to this length [characters] is read once more by the slower parser, for a better message."""


def parse(text: str, file: str) -> Node:
    """Parse one document.

    Args:
        text: YAML.
        file: Name for messages.

    Raises:
        RecipeError: A syntax error, a duplicate key, a tag, a merge key, an alias or several documents.
    """
    try:
        root = _Builder(file).build(PARSER(text))
    except yaml.YAMLError as error:
        raise _syntax_error(error, text, file) from None
    if root is None:
        raise RecipeError("the file is empty", code="DXB-R101", where=Place(file))
    return root


def scalar(text: str) -> Any:
    """The value of one flow-style YAML text, as on the command line: `0.001`, `[box, cylinder]`."""
    return parse(text, "the command line").plain() if text else ""


class _Builder:
    """From parser events to nodes, without recursion."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._root: Node | None = None
        self._open: list[tuple[Node, Any, array[int], str | None, int]] = []
        """Mappings and sequences that are not closed yet: their values, where keys stand, the anchor, values before."""
        self._key: list[str | None] = []
        """For each of them the key that waits for its value."""
        self._heights: list[int] = []
        """For each of them how many levels lie in it so far."""
        self._anchors: dict[str, tuple[Node, int, int]] = {}
        """Node, how many values it is, how many levels."""
        self._values = self._aliased = 0

    def build(self, parser: Any) -> Node | None:
        """The node of the one document, None where there is none."""
        take: dict[type, Callable[[Any], None]] = {
            yaml.ScalarEvent: self._scalar,
            yaml.MappingStartEvent: self._begin,
            yaml.SequenceStartEvent: self._begin,
            yaml.MappingEndEvent: self._end,
            yaml.SequenceEndEvent: self._end,
            yaml.AliasEvent: self._alias,
            yaml.DocumentStartEvent: self._document,
        }
        event = parser.get_event()
        while event is not None:
            handle = take.get(type(event))
            if handle is not None:
                handle(event)
            event = None if isinstance(event, yaml.StreamEndEvent) else parser.get_event()
        return self._root

    def _document(self, event: Any) -> None:
        if self._root is not None:
            raise yaml.MarkedYAMLError(problem="but found another document", problem_mark=event.start_mark)

    def _scalar(self, event: Any) -> None:
        mark = mark_of(event.start_mark)
        text: str = event.value
        if event.tag is not None and event.tag != "!":
            value = _tagged(event.tag, text, place_of(self._file, mark))
        else:
            value = _plain(text, self._file, mark) if event.implicit[0] else text
        if event.anchor is None and self._awaits_key():
            self._name(value, mark)
            return
        node = Node(value, self._file, mark)
        if event.anchor is not None:
            self._anchors[event.anchor] = (node, 1, 0)
        self._take(node, mark, 0)

    def _awaits_key(self) -> bool:
        return bool(self._open) and self._key[-1] is None and type(self._open[-1][1]) is dict

    def _take(self, node: Node, mark: int, height: int) -> None:
        if self._awaits_key():
            self._name(node.value, mark)
        else:
            self._add(node, height)

    def _begin(self, event: Any) -> None:
        mark = mark_of(event.start_mark)
        is_mapping = isinstance(event, yaml.MappingStartEvent)
        if event.tag not in (None, "!", f"{_CORE}{'map' if is_mapping else 'seq'}"):
            raise _unknown_tag(event.tag, place_of(self._file, mark))
        if self._awaits_key():
            raise _no_text({} if is_mapping else [], place_of(self._file, mark))
        self._limit_depth(1, mark)
        value: Any = {} if is_mapping else []
        marks = array("Q")
        node = Node(value, self._file, mark, marks)
        self._open.append((node, value, marks, event.anchor, self._values))
        self._key.append(None)
        self._heights.append(1)

    def _end(self, event: Any) -> None:
        node, _, _, anchor, before = self._open.pop()
        self._key.pop()
        height = self._heights.pop()
        if anchor is not None:
            self._anchors[anchor] = (node, self._values - before + 1, height)
        self._add(node, height)

    def _alias(self, event: Any) -> None:
        if event.anchor not in self._anchors:
            raise yaml.MarkedYAMLError(problem=f"found undefined alias {event.anchor!r}", problem_mark=event.start_mark)
        node, values, height = self._anchors[event.anchor]
        mark = mark_of(event.start_mark)
        self._limit_depth(height, mark)
        self._values += values
        self._aliased += values
        if self._aliased > _MOST_ALIASED:
            raise RecipeError(
                f"aliases expand to more than {_MOST_ALIASED} values",
                code="DXB-R101",
                where=place_of(self._file, mark),
                hint="write the values down, or use a recipe within a recipe",
            )
        self._take(node, mark, height)

    def _limit_depth(self, more: int, mark: int) -> None:
        if len(self._open) + more > _DEEPEST:
            message = f"values are nested more than {_DEEPEST} deep"
            raise RecipeError(message, code="DXB-R101", where=place_of(self._file, mark))

    def _name(self, key: Any, mark: int) -> None:
        _, mapping, marks, _, _ = self._open[-1]
        if not isinstance(key, str) or key == "<<":
            raise _no_text(key, place_of(self._file, mark))
        if key in mapping:
            first = place_of(self._file, marks[list(mapping).index(key)])
            raise RecipeError(
                f"`{key}` stands twice in one mapping",
                code="DXB-R103",
                where=place_of(self._file, mark),
                facts={"first": first},
            )
        # Keys within a call stand in many. Names of calls do not, and the table of interned texts never shrinks.
        self._key[-1] = sys.intern(key) if len(self._open) > _NAMES_DEPTH else key
        marks.append(mark)

    def _add(self, node: Node, height: int) -> None:
        self._values += 1
        if not self._open:
            self._root = node
            return
        self._heights[-1] = max(self._heights[-1], height + 1)
        inside = self._open[-1][1]
        if isinstance(inside, list):
            inside.append(node)
        else:
            inside[self._key[-1]] = node
            self._key[-1] = None


def _plain(text: str, file: str, mark: int) -> Any:
    if not text:
        return None
    for kind, form in _PLAIN.get(text[0], ()):
        if form.match(text):
            if len(text) > _MOST_DIGITS:
                raise _no_value(f"a number has more than {_MOST_DIGITS} digits", place_of(file, mark))
            return _value(kind, text)
    return text


def _tagged(tag: str, text: str, place: Place) -> Any:
    kind = tag.removeprefix(_CORE)
    forms = {name: form for name, form, _ in _SCALARS}
    if tag == kind or kind not in ("str", *forms):
        raise _unknown_tag(tag, place)
    if kind != "str" and not (len(text) <= _MOST_DIGITS and forms[kind].match(text)):
        raise _no_value(f"a value with the tag `{kind}` is none", place)
    return _value(kind, text)


def _value(kind: str, text: str) -> Any:
    match kind:
        case "null":
            return None
        case "bool":
            return text.lower() == "true"
        case "int":
            return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
        case "float":
            return float(text)
    return text


def _unknown_tag(tag: str, place: Place) -> RecipeError:
    return RecipeError(f"the tag `{tag}` is not known here", code="DXB-R102", where=place)


def _no_value(message: str, place: Place) -> RecipeError:
    """A scalar cannot be what it is said to be."""
    return RecipeError(message, code="DXB-R102", where=place, hint="quote it if it is text")


def _no_text(key: object, place: Place) -> RecipeError:
    return RecipeError(f"a key must be text, this one is {key!r}", code="DXB-R102", where=place)


def _syntax_error(error: yaml.YAMLError, text: str, file: str) -> RecipeError:
    if PARSER is not yaml.SafeLoader and len(text) <= _MOST_REREAD:
        # libyaml says less well what is wrong than the parser in Python.
        try:
            _Builder(file).build(yaml.SafeLoader(text))
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
