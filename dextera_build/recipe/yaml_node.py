"""Values of a YAML file, each with its place."""

from __future__ import annotations

import marshal
from collections.abc import Iterator, Sequence
from typing import Any

from dextera_build.errors import Place

_COLUMNS = 1 << 24
_NESTED = (dict, list, bytes)
"""Kinds of what is held of a value that is no scalar, or that is packed."""


class Node:
    """One YAML value with its place; a mapping holds `dict[str, Node]`, a sequence `list[Node]`.

    A recipe of a hundred thousand nodes has millions of these, so places are made when somebody asks, and a value may
    be held as a few bytes (`pack`): a call of such a recipe then takes 0.3 KB rather than 2.

    Args:
        value: What stands there.
        file: Name of the file, for messages.
        mark: Line and column in one number; see `mark_of`.
        marks: Of a mapping: where its keys stand, in their order.
    """

    __slots__ = ("_file", "_held", "_mark", "_marks")

    def __init__(self, value: Any, file: str, mark: int = 0, marks: Sequence[int] = ()) -> None:
        self._held = value
        """The value, or bytes, which no YAML value is, that it can be made of."""
        self._file = file
        self._mark = mark
        self._marks = marks

    @property
    def value(self) -> Any:
        """What stands there."""
        held = self._held
        return held if type(held) is not bytes else self.opened()._held

    def pack(self) -> None:
        """Hold a mapping as bytes from now on; what is asked of it is made anew each time."""
        if type(self._held) is not bytes:
            # Copied, for `marshal` gives its result from a large block cut short, and those lie where holes remain.
            self._held, self._marks = bytes(memoryview(marshal.dumps(_packed(self, self._mark)))), ()

    def opened(self) -> Node:
        """The same value, at hand: for who asks more than once."""
        if type(self._held) is not bytes:
            return self
        return _unpacked(marshal.loads(self._held), self._file, self._mark)

    def outline(self) -> dict[str, Any] | None:
        """Of a mapping that is held as bytes: its keys, each with its scalar or (); of all else None."""
        if type(self._held) is not bytes:
            return None
        _, keys, inside, _ = marshal.loads(self._held)
        return {key: plain[1] if len(plain) == 2 else () for key, plain in zip(keys, inside, strict=True)}

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
        here = self.opened()
        for (name, inner), mark in zip(here._held.items(), here._marks, strict=True):
            yield name, place_of(here._file, mark), inner

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
        return Node(value, self._file, self._mark, self.opened()._marks)

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


def _packed(node: Node, base: int) -> tuple[Any, ...]:
    """A value as plain data; marks count from `base`, which makes most of them small."""
    value, mark = node._held, node._mark - base
    if type(value) is bytes:
        return _packed(node.opened(), base)
    if isinstance(value, dict):
        inside = tuple(
            [
                _packed(inner, base) if type(inner._held) in _NESTED else (inner._mark - base, inner._held)
                for inner in value.values()
            ]
        )
        return mark, tuple(value), inside, tuple([place - base for place in node._marks])
    if isinstance(value, list):
        return mark, None, tuple([_packed(inner, base) for inner in value])
    return mark, value


def _unpacked(plain: tuple[Any, ...], file: str, base: int) -> Node:
    mark = base + plain[0]
    if len(plain) == 2:
        return Node(plain[1], file, mark)
    inside = [
        Node(inner[1], file, base + inner[0]) if len(inner) == 2 else _unpacked(inner, file, base) for inner in plain[2]
    ]
    if plain[1] is None:
        return Node(inside, file, mark)
    return Node(dict(zip(plain[1], inside, strict=True)), file, mark, [base + place for place in plain[3]])
