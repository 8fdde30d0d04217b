"""The members of a graph as plain data in bytes, one behind the other, each read when it is asked for.

As objects a call takes 1.5 KB, in bytes 0.15. A plan is made of such bytes, and a build that goes on from the last one
need not plan anew: it finds them in a file. They are JSON, since a file may have been written by somebody else.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zlib
from array import array
from bisect import bisect_left
from collections.abc import ItemsView, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

from dextera_build.engine.graph import Call, Fixed, Gather, Graph, Group, Input, Item, Leaf, Output, Pack, RuleFacts
from dextera_build.errors import Place

_scan = json.JSONDecoder().raw_decode
_AT_ONCE = 20_000
"""So many hashes are sorted in one go at most."""
_PARTS = 16
_RECENT = 1024
"""So many calls are held as objects at least, and twice as many at most: what is asked for is asked for again soon."""


def hash_of(name: str) -> int:
    """Eight bytes that stand for a name."""
    return int.from_bytes(hashlib.blake2b(name.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "big")


def short_hash_of(name: str) -> int:
    """Four bytes that stand for a name where that can be looked at, too; six times as quick as `hash_of`."""
    return zlib.crc32(name.encode("utf-8", "surrogatepass"))


class Names:
    """Finds the number of a name without holding names.

    Args:
        hashes: Of the names, by `hash_of` or, in an array of four bytes each, by `short_hash_of`.
        numbers: Those of the names, in the same order.
    """

    def __init__(self, hashes: array[int], numbers: array[int]) -> None:
        self.hashes = hashes
        """In ascending order."""
        self.numbers = numbers

    @classmethod
    def of(cls, names: Iterable[str]) -> Names:
        """The numbers of names, in their order."""
        return cls.of_hashes(array("Q", map(hash_of, names)))

    @classmethod
    def of_hashes(cls, found: array[int]) -> Names:
        """The numbers of names that have these hashes."""
        numbers = array("I")
        for some in _parts(found):
            numbers.extend(sorted(some, key=found.__getitem__))
        return cls(array(found.typecode, (found[number] for number in numbers)), numbers)

    @property
    def are_distinct(self) -> bool:
        """Whether no two names have one hash, so that `find` cannot err in a name that is there."""
        return all(self.hashes[place] != self.hashes[place + 1] for place in range(len(self.hashes) - 1))

    def find(self, name: str) -> int | None:
        """The number of a name, or None where there is none of this hash."""
        return next(iter(self.candidates(name)), None)

    def candidates(self, name: str) -> array[int]:
        """The numbers of all names that have the hash of this one."""
        hashes = self.hashes
        wanted = short_hash_of(name) if hashes.typecode == "I" else hash_of(name)
        first = end = bisect_left(hashes, wanted)
        while end < len(hashes) and hashes[end] == wanted:
            end += 1
        return self.numbers[first:end]


def _parts(found: array[int]) -> Iterator[Iterable[int]]:
    """The places of all numbers, those of small ones first: to sort all at once takes 80 bytes for each."""
    if len(found) < _AT_ONCE:
        yield range(len(found))
        return
    low = min(found)
    size = max(found) - low + 1
    parts = bytes((one - low) * _PARTS // size for one in found)
    for part in range(_PARTS):
        yield (place for place, one in enumerate(parts) if one == part)


class Texts:
    """Texts, one behind the other.

    Args:
        heap: All of them.
        ends: Where each ends, after a 0.
    """

    def __init__(self, heap: bytearray | memoryview, ends: array[int]) -> None:
        self.heap = heap
        self.ends = ends

    def __len__(self) -> int:
        return len(self.ends) - 1

    def __getitem__(self, number: int) -> bytes:
        return bytes(self.heap[self.ends[number] : self.ends[number + 1]])


class Members(Mapping[str, Call | Group]):
    """Members of a graph, each made of its text when it is asked for.

    Args:
        names: Finds a member's number.
        texts: Of the members, in the order of the recipe.
        rules: What calls refer to.
        groups: Those that have no text; they come first.
    """

    def __init__(
        self, names: Names, texts: Texts, rules: Sequence[RuleFacts], groups: Mapping[str, Group] | None = None
    ) -> None:
        self.names = names
        self.texts = texts
        self.rules = rules
        self.groups = groups or {}
        self._groups = dict(self.groups)
        self._recent: dict[str, Call] = {}
        self._before: dict[str, Call] = {}
        """What was asked for before the first of `_recent`."""

    def __getitem__(self, name: str) -> Call | Group:
        known = self._recent.get(name)
        if known is not None:
            return known
        again = self._before.get(name) or self._groups.get(name)
        if again is not None:
            return self._held(again)
        for number in self.names.candidates(name):
            member = self._member(number)
            if member.name == name:
                return self._held(member)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        yield from self.groups
        yield from self.names_of_texts()

    def __len__(self) -> int:
        return len(self.groups) + len(self.texts)

    def items(self) -> ItemsView[str, Call | Group]:
        """Name and member, one after another; none of them is held."""
        return _Items(self)

    def each(self) -> Iterator[Call | Group]:
        """All members, one after another."""
        return chain(self.groups.values(), map(self._member, range(len(self.texts))))

    def names_of_texts(self) -> Iterator[str]:
        """The names of members that have texts, in the order of these."""
        plain = map(self._plain, range(len(self.texts)))
        return (one["group"] if isinstance(one, dict) else one[0] for one in plain)

    def _held(self, member: Call | Group) -> Call | Group:
        if isinstance(member, Group):
            self._groups[member.name] = member
        else:
            if len(self._recent) >= _RECENT:
                self._recent, self._before = {}, self._recent
            self._recent[member.name] = member
        return member

    def _plain(self, number: int) -> Any:
        return _scan(str(self.texts[number], "ascii"))[0]

    def _member(self, number: int) -> Call | Group:
        return self._read(self._plain(number))

    def _read(self, plain: Any) -> Call | Group:
        if isinstance(plain, list):
            return self._call(plain)
        name, over, members, overrides, where = plain.values()
        source = Fixed(tuple(over[1])) if over[0] == "fixed" else _input_of(over)
        assert isinstance(source, Output | Item | Fixed)
        inner = [self._read(member) for member in members]
        replaced = {label: {one: self._call(call) for one, call in calls.items()} for label, calls in overrides.items()}
        return Group(name, source, {member.name: member for member in inner}, replaced, Place(*where))

    def _call(self, plain: Any) -> Call:
        name, rule, options, inputs, where, places, *salt = plain
        return Call(
            name,
            self.rules[rule],
            options,
            {slot: _input_of(source) for slot, source in inputs.items()},
            Place(*where),
            _Places(where[0], places),
            *salt,
        )


class _Places(Mapping[str, Place]):
    """Where options are set; made when asked for, which is seldom."""

    __slots__ = ("_file", "_plain")

    def __init__(self, file: str, plain: Mapping[str, Any]) -> None:
        self._file, self._plain = file, plain

    def __getitem__(self, option: str) -> Place:
        place = self._plain[option]
        return Place(self._file, *place) if len(place) == 2 else Place(*place)

    def __iter__(self) -> Iterator[str]:
        return iter(self._plain)

    def __len__(self) -> int:
        return len(self._plain)


class _Items(ItemsView[str, Call | Group]):
    _mapping: Members

    def __iter__(self) -> Iterator[tuple[str, Call | Group]]:
        return ((member.name, member) for member in self._mapping.each())


class Writer:
    """Turns members into texts; those of one rule refer to it by its number.

    Args:
        rules: Those that have numbers already.
    """

    def __init__(self, rules: Iterable[RuleFacts] = ()) -> None:
        self._rules = {id(rule): (number, rule) for number, rule in enumerate(rules)}
        self._hashes = array("I")
        self._heap = bytearray()
        self._ends = array("Q", [0])

    def add(self, member: Call | Group) -> None:
        """Take one more member."""
        self.copy(member.name, json.dumps(self._member(member)).encode())

    def copy(self, name: str, text: bytes) -> None:
        """Take one more member, which has a text already."""
        self._hashes.append(short_hash_of(name))
        self._heap += text
        self._ends.append(len(self._heap))

    def members(self, groups: Mapping[str, Group] | None = None) -> Members:
        """All that was taken, after some groups that need no texts."""
        rules = [rule for _, rule in self._rules.values()]
        return Members(Names.of_hashes(self._hashes), Texts(self._heap, self._ends), rules, groups)

    def _member(self, member: Call | Group) -> list[Any] | dict[str, Any]:
        if isinstance(member, Call):
            return self._call(member)
        overrides = {
            label: {name: self._call(call) for name, call in calls.items()} for label, calls in member.overrides.items()
        }
        inner = [self._member(one) for one in member.members.values()]
        return {
            "group": member.name,
            "over": _over_to_plain(member.over),
            "members": inner,
            "overrides": overrides,
            "where": _place_to_plain(member.where),
        }

    def _call(self, call: Call) -> list[Any]:
        number, _ = self._rules.setdefault(id(call.rule), (len(self._rules), call.rule))
        return [
            call.name,
            number,
            dict(call.options),
            {slot: _input_to_plain(source) for slot, source in call.inputs.items()},
            _place_to_plain(call.where),
            {name: _place_to_plain(place, call.where.file) for name, place in call.option_places.items()},
            *([call.salt] if call.salt else ()),
        ]


def members_of(graph: Graph) -> Members:
    """The members of a graph, all of them with texts."""
    members = graph.members
    if isinstance(members, Members) and not members.groups:
        return members
    known = members if isinstance(members, Members) else None
    writer = Writer(known.rules if known else ())
    for member in known.groups.values() if known else members.values():
        writer.add(member)
    if known:
        for number, name in enumerate(known.names_of_texts()):
            writer.copy(name, known.texts[number])
    return writer.members()


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


def _place_to_plain(place: Place, near: str | None = None) -> list[Any]:
    """Without the file where it is `near`: then it goes without saying."""
    return [place.line, place.column] if place.file == near else [place.file, place.line, place.column]


def _over_to_plain(source: Output | Item | Fixed) -> list[Any] | dict[str, Any] | str:
    return ["fixed", source.labels] if isinstance(source, Fixed) else _input_to_plain(source)


def _input_to_plain(source: Input) -> list[Any] | dict[str, Any] | str:
    if isinstance(source, Leaf):
        return ["leaf", str(source.path), _place_to_plain(source.where)]
    if isinstance(source, Output):
        # What most inputs are is a word: a graph of many nodes has still more of them.
        return source.call[0] if len(source.call) == 1 and not source.fields else ["output", source.call, source.fields]
    if isinstance(source, Item):
        return ["item", source.group, source.fields]
    if isinstance(source, Gather):
        return ["gather", source.call, source.fields]
    return {label: _input_to_plain(part) for label, part in source.parts.items()}


def _input_of(plain: Any) -> Input:
    if type(plain) is str:
        return _output_of(plain)
    if type(plain) is dict:
        parts = plain.items()
        return Pack({label: _output_of(part) if type(part) is str else _part_of(part) for label, part in parts})
    return _part_of(plain)


def _part_of(plain: Any) -> Leaf | Output | Item | Gather:
    if type(plain) is str:
        return _output_of(plain)
    kind, first, more = plain
    if kind == "leaf":
        return Leaf(Path(first), Place(*more))
    address, fields = tuple(first), tuple(more)
    if kind == "output":
        return Output(address, fields)
    return Item(address, fields) if kind == "item" else Gather(address, fields)


@lru_cache(_RECENT)
def _output_of(name: str) -> Output:
    """What a call at the root returns; several calls that stand together read the same."""
    return Output((name,))
