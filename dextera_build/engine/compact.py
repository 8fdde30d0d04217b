"""A graph as bytes whose members are read one by one: what a build of a hundred thousand nodes need not plan anew.

A head (JSON: name, targets, rules) and a heap of JSON texts, one a member of the graph, found by the hash of its name.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from array import array
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dextera_build.engine.graph import Call, Fixed, Gather, Graph, Group, Input, Item, Leaf, Output, Pack, RuleFacts
from dextera_build.errors import Place

_ENCODE = json.JSONEncoder(ensure_ascii=False, separators=(",", ":"), default=dict).encode


def hash_of(name: str) -> int:
    """Eight bytes that stand for a name."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "big")


class Names:
    """Finds the number of a name without holding names."""

    def __init__(self, hashes: array[int], numbers: array[int]) -> None:
        self.hashes = hashes
        self.numbers = numbers

    @classmethod
    def of(cls, names: Sequence[str]) -> Names | None:
        """The numbers of names, or None where two have one hash."""
        pairs = sorted((hash_of(name), number) for number, name in enumerate(names))
        hashes = array("Q", [first for first, _ in pairs])
        if any(hashes[place] == hashes[place + 1] for place in range(len(hashes) - 1)):
            return None
        return cls(hashes, array("I", [number for _, number in pairs]))

    def find(self, name: str) -> int | None:
        """The number of a name, or None where there is none of this hash."""
        wanted = hash_of(name)
        place = bisect_left(self.hashes, wanted)
        if place < len(self.hashes) and self.hashes[place] == wanted:
            return self.numbers[place]
        return None


class Writer:
    """Turns a graph into a head and a heap."""

    def __init__(self) -> None:
        self._rules: dict[int, tuple[int, RuleFacts]] = {}

    def write(self, graph: Graph) -> tuple[dict[str, Any], list[bytes]]:
        """(head, one text a member)."""
        texts = [_ENCODE(self._member(member)).encode() for member in graph.members.values()]
        head = {
            "name": graph.name,
            "targets": graph.targets,
            "rules": [facts_to_plain(rule) for _, rule in self._rules.values()],
        }
        return head, texts

    def _member(self, member: Call | Group) -> list[Any]:
        if isinstance(member, Call):
            return ["call", *self._call(member)]
        overrides = {
            label: {name: self._call(call) for name, call in calls.items()} for label, calls in member.overrides.items()
        }
        inner = [self._member(one) for one in member.members.values()]
        return ["group", member.name, _over_to_plain(member.over), inner, overrides, _place_to_plain(member.where)]

    def _call(self, call: Call) -> list[Any]:
        number, _ = self._rules.setdefault(id(call.rule), (len(self._rules), call.rule))
        return [
            call.name,
            number,
            call.options,
            {slot: _input_to_plain(source) for slot, source in call.inputs.items()},
            _place_to_plain(call.where),
            {name: _place_to_plain(place) for name, place in call.option_places.items()},
            call.salt,
        ]


class Members(Mapping[str, Call | Group]):
    """Members of a graph, each read when it is asked for.

    Args:
        names: Finds a member's number.
        text: The text of a member by its number.
        rules: What calls refer to.
        order: Numbers in the order of the recipe.
    """

    def __init__(self, names: Names, text: Any, rules: Sequence[RuleFacts]) -> None:
        self._names = names
        self._text = text
        self._rules = rules
        self._known: dict[str, Call | Group] = {}

    def __getitem__(self, name: str) -> Call | Group:
        if name not in self._known:
            number = self._names.find(name)
            member = self._read(json.loads(self._text(number))) if number is not None else None
            if member is None or member.name != name:
                raise KeyError(name)
            self._known[name] = member
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        for number in range(len(self)):
            yield json.loads(self._text(number))[1]

    def __len__(self) -> int:
        return len(self._names.hashes)

    def _read(self, plain: Any) -> Call | Group:
        if plain[0] == "call":
            return self._call(plain[1:])
        _, name, over, members, overrides, where = plain
        source = Fixed(tuple(over[1])) if over[0] == "fixed" else _input_of(over)
        assert isinstance(source, Output | Item | Fixed)
        inner = [self._read(member) for member in members]
        replaced = {label: {one: self._call(call) for one, call in calls.items()} for label, calls in overrides.items()}
        return Group(name, source, {member.name: member for member in inner}, replaced, Place(*where))

    def _call(self, plain: Any) -> Call:
        name, rule, options, inputs, where, places, salt = plain
        return Call(
            name,
            self._rules[rule],
            options,
            {slot: _input_of(source) for slot, source in inputs.items()},
            Place(*where),
            {option: Place(*place) for option, place in places.items()},
            salt,
        )


def facts_to_plain(facts: RuleFacts) -> dict[str, Any]:
    """The facts of a rule as JSON data."""
    return dataclasses.asdict(facts)


def facts_of(plain: Mapping[str, Any]) -> RuleFacts:
    """The facts that `facts_to_plain` wrote down."""
    found: dict[str, Any] = {}
    for field in dataclasses.fields(RuleFacts):
        value = plain[field.name]
        if dataclasses.is_dataclass(field.default) and not isinstance(field.default, type):
            value = type(field.default)(**{name: _tuples(inner) for name, inner in value.items()})
        found[field.name] = _tuples(value)
    return RuleFacts(**found)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(inner) for inner in value) if isinstance(value, list) else value


def _place_to_plain(place: Place) -> list[Any]:
    return [place.file, place.line, place.column]


def _over_to_plain(source: Output | Item | Fixed) -> list[Any]:
    return ["fixed", source.labels] if isinstance(source, Fixed) else _input_to_plain(source)


def _input_to_plain(source: Input) -> list[Any]:
    if isinstance(source, Leaf):
        return ["leaf", str(source.path), _place_to_plain(source.where)]
    if isinstance(source, Output):
        return ["output", source.call, source.fields]
    if isinstance(source, Item):
        return ["item", source.group, source.fields]
    if isinstance(source, Gather):
        return ["gather", source.call, source.fields]
    return ["pack", {label: _input_to_plain(part) for label, part in source.parts.items()}]


def _input_of(plain: Any) -> Input:
    kind, first, *rest = plain
    if kind == "leaf":
        return Leaf(Path(first), Place(*rest[0]))
    if kind == "pack":
        parts = {label: _input_of(part) for label, part in first.items()}
        return Pack({label: part for label, part in parts.items() if not isinstance(part, Pack)})
    address, fields = tuple(first), tuple(rest[0])
    if kind == "output":
        return Output(address, fields)
    return Item(address, fields) if kind == "item" else Gather(address, fields)
