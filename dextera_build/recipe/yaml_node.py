"""Values of a YAML file, each with its place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from dextera_build.errors import Place

_COLUMNS = 1 << 24


class Node:
    """One YAML value with its place; a mapping holds `dict[str, Node]`, a sequence `list[Node]`.

    Places are made when they are asked for: a large recipe has a million values.

    Args:
        value: The value.
        file: Name of the file, for messages.
        mark: Line and column in one number; see `mark_of`.
        marks: Of a mapping: the places of its keys, in their order.
    """

    __slots__ = ("_file", "_mark", "_marks", "value")

    def __init__(self, value: Any, file: str, mark: int = 0, marks: Sequence[int] = ()) -> None:
        self.value = value
        self._file = file
        self._mark = mark
        self._marks = marks

    @property
    def place(self) -> Place:
        """Where it stands."""
        return place_of(self._file, self._mark)

    @property
    def keys(self) -> dict[str, Place]:
        """Where each key of a mapping stands."""
        return {name: place for name, place, _ in self.entries()}

    def entries(self) -> Iterator[tuple[str, Place, Node]]:
        """Key, its place and value of each entry of a mapping, one after another: there may be many."""
        for (name, inner), mark in zip(self.value.items(), self._marks, strict=True):
            yield name, place_of(self._file, mark), inner

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

    def placed(self, place: Place) -> Node:
        """The same value with one place for all of it."""
        value = self.value
        if isinstance(value, dict):
            inside: Any = {name: inner.placed(place) for name, inner in value.items()}
        else:
            inside = [inner.placed(place) for inner in value] if isinstance(value, list) else value
        mark = place.line * _COLUMNS + place.column
        return Node(inside, place.file, mark, [mark] * len(inside) if isinstance(inside, dict) else ())

    def holding(self, value: Any) -> Node:
        """Another value at the place of this one; where this is a mapping, with its keys."""
        return Node(value, self._file, self._mark, self._marks)

    def at(self, path: tuple[object, ...]) -> Place:
        """The place of the value below `path` of keys and indices, or of the deepest part that exists."""
        node = self
        for step in path:
            value = node.value
            parts = dict(enumerate(value)) if isinstance(value, list) else value
            if not isinstance(parts, dict) or step not in parts:
                break
            node = parts[step]
        return node.place


def mark_of(mark: Any) -> int:
    """Line and column of a parser's mark in one number, both from 1."""
    return int(mark.line + 1) * _COLUMNS + int(mark.column) + 1


def place_of(file: str, mark: int) -> Place:
    """The place that `mark_of` packed."""
    return Place(file, *divmod(mark, _COLUMNS))
