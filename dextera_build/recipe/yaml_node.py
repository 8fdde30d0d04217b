"""Values of a YAML file, each with its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dextera_build.errors import Place

_COLUMNS = 1 << 24


class Node:
    """One YAML value with its place; a mapping holds `dict[str, Node]`, a sequence `list[Node]`.

    A recipe of a hundred thousand nodes has millions of these, so places are made when somebody asks.

    Args:
        value: What stands there.
        file: Name of the file, for messages.
        mark: Line and column in one number; see `mark_of`.
        marks: Of a mapping: where its keys stand, in their order.
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
        return {name: place_of(self._file, mark) for name, mark in zip(self.value, self._marks, strict=True)}

    @property
    def kind(self) -> str:
        """`mapping`, `list`, `text`, `number`, `true/false` or `nothing`."""
        names = {dict: "mapping", list: "list", str: "text", bool: "true/false", type(None): "nothing"}
        return names.get(type(self.value), "number")

    def plain(self) -> Any:
        """The value without places."""
        if isinstance(self.value, dict):
            return {name: inner.plain() for name, inner in self.value.items()}
        if isinstance(self.value, list):
            return [inner.plain() for inner in self.value]
        return self.value

    def placed(self, place: Place) -> Node:
        """The same value with one place for all of it."""
        if isinstance(self.value, dict):
            inside: Any = {name: inner.placed(place) for name, inner in self.value.items()}
        else:
            inside = [inner.placed(place) for inner in self.value] if isinstance(self.value, list) else self.value
        mark = place.line * _COLUMNS + place.column
        return Node(inside, place.file, mark, [mark] * len(inside) if isinstance(inside, dict) else ())

    def holding(self, value: Any) -> Node:
        """Another value at the place of this one; where this is a mapping, with its keys."""
        return Node(value, self._file, self._mark, self._marks)

    def at(self, path: tuple[object, ...]) -> Place:
        """The place of the value below `path` of keys and indices, or of the deepest part that exists."""
        node = self
        for step in path:
            parts = dict(enumerate(node.value)) if isinstance(node.value, list) else node.value
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
