"""A plan as JSON and back, so that a later command can use it. Parts that many calls share are written once."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from dextera_build.engine.graph import (
    Call,
    Fixed,
    Gather,
    Graph,
    Group,
    Input,
    Item,
    Leaf,
    Output,
    Pack,
    Plan,
    RuleFacts,
)
from dextera_build.errors import Place
from dextera_build.workers.retries import Retries

_FACTS = [field.name for field in fields(RuleFacts) if field.name not in ("code", "sources", "retries")]
_TUPLES = {"weights", "named", "passed", "missing"}


def write(plan: Plan) -> str:
    """A plan whose inputs are all given as JSON."""
    return _Writer().plan(plan)


def read(text: str) -> Plan:
    """The plan that `write` wrote.

    Raises:
        ValueError: The text is none, or another error of access to plain data.
    """
    rules, files, places, *rest = json.loads(text)
    return _Reader(rules, files, places).plan(*rest)


class _Table:
    """Values that are written once, by number."""

    def __init__(self) -> None:
        self.rows: list[Any] = []
        self._known: dict[Any, int] = {}

    def number(self, value: Any, row: Any) -> int:
        """The number of a hashable value; its row is added once."""
        known = self._known.setdefault(value, len(self.rows))
        if known == len(self.rows):
            self.rows.append(row)
        return known


class _Writer:
    def __init__(self) -> None:
        self._rules, self._files, self._places = _Table(), _Table(), _Table()

    def plan(self, plan: Plan) -> str:
        graph = plan.graph
        targets = {name: list(map(list, calls)) for name, calls in graph.targets.items()}
        whole = [graph.name, self._members(graph.members), targets]
        used = [self._rule(rule) for rule in plan.rules]
        tables = [self._rules.rows, self._files.rows, self._places.rows]
        recipes = [str(path) for path in plan.recipes]
        return json.dumps([*tables, whole, recipes, used, dict(plan.kinds)], separators=(",", ":"))

    def _members(self, members: Mapping[str, Call | Group]) -> list[Any]:
        return [[name, *self._member(member)] for name, member in members.items()]

    def _member(self, member: Call | Group) -> list[Any]:
        if isinstance(member, Call):
            return ["call", self._call(member)]
        overrides = [
            [label, [[name, self._call(call)] for name, call in calls.items()]]
            for label, calls in member.overrides.items()
        ]
        over = ["fixed", list(member.over.labels)] if isinstance(member.over, Fixed) else self._input(member.over)
        inside = self._members(member.members)
        place = self._place(member.where)
        return ["group", [member.name, over, inside, overrides, place, member.on_failure, dict(member.named)]]

    def _call(self, call: Call) -> list[Any]:
        inputs = [[slot, *self._input(source)] for slot, source in call.inputs.items()]
        places = {name: self._place(place) for name, place in call.option_places.items()}
        return [
            call.name,
            self._rule(call.rule),
            dict(call.options),
            inputs,
            self._place(call.where),
            places,
            call.salt,
            call.on_failure,
        ]

    def _input(self, source: Input) -> list[Any]:
        if isinstance(source, Leaf):
            return ["leaf", str(source.path), self._place(source.where)]
        if isinstance(source, Pack):
            return ["pack", [[label, *self._input(part)] for label, part in source.parts.items()]]
        if isinstance(source, Gather):
            return ["gather", list(source.call), list(source.fields)]
        if isinstance(source, Item):
            return ["item", list(source.group), list(source.fields), source.optional]
        return ["output", list(source.call), list(source.fields), source.optional]

    def _place(self, place: Place) -> int:
        return self._places.number(place, [place.file, place.line, place.column])

    def _rule(self, rule: RuleFacts) -> int:
        number = self._rules.number(id(rule), None)  # the plan keeps all rules alive
        if self._rules.rows[number] is None:
            code = {file: self._file(definitions) for file, definitions in rule.code.items()}
            retries = [rule.retries.most, list(rule.retries.on), rule.retries.wait_s]
            facts = {name: _plain(getattr(rule, name)) for name in _FACTS}
            self._rules.rows[number] = [facts, code, list(rule.sources.items()), retries]
        return number

    def _file(self, definitions: Mapping[str, str]) -> int:
        return self._files.number(tuple(definitions.items()), dict(definitions))


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


class _Reader:
    def __init__(self, rules: list[Any], files: list[dict[str, str]], places: list[Any]) -> None:
        self._files = files
        self._places = [Place(*place) for place in places]
        self._rules = [self._rule(*row) for row in rules]

    def plan(self, graph: Any, recipes: list[str], used: list[int], kinds: dict[str, str]) -> Plan:
        name, members, targets = graph
        named = {target: tuple(map(tuple, calls)) for target, calls in targets.items()}
        whole = Graph(name, self._members(members), named)
        return Plan(whole, tuple(map(Path, recipes)), tuple(self._rules[number] for number in used), kinds=kinds)

    def _members(self, rows: Iterable[Any]) -> dict[str, Call | Group]:
        return {name: self._call(row) if kind == "call" else self._group(row) for name, kind, row in rows}

    def _group(self, row: list[Any]) -> Group:
        name, over, inside, overrides, place, on_failure, named = row
        replaced = {label: {inner: self._call(call) for inner, call in calls} for label, calls in overrides}
        opens = Fixed(tuple(over[1])) if over[0] == "fixed" else self._part(*over)
        assert not isinstance(opens, Leaf | Gather)
        return Group(name, opens, self._members(inside), replaced, self._places[place], on_failure, named)

    def _call(self, row: list[Any]) -> Call:
        name, rule, options, inputs, place, option_places, salt, on_failure = row
        given = {slot: self._input(*source) for slot, *source in inputs}
        places = {option: self._places[number] for option, number in option_places.items()}
        return Call(name, self._rules[rule], options, given, self._places[place], places, salt, on_failure)

    def _input(self, kind: str, *rest: Any) -> Input:
        if kind == "pack":
            return Pack({label: self._part(*part) for label, *part in rest[0]})
        return self._part(kind, *rest)

    def _part(self, kind: str, *rest: Any) -> Leaf | Output | Item | Gather:
        if kind == "output":
            return Output(tuple(rest[0]), tuple(rest[1]), rest[2])
        if kind == "leaf":
            return Leaf(Path(rest[0]), self._places[rest[1]])
        if kind == "item":
            return Item(tuple(rest[0]), tuple(rest[1]), rest[2])
        return Gather(tuple(rest[0]), tuple(rest[1]))

    def _rule(self, facts: dict[str, Any], code: dict[str, int], sources: list[Any], retries: list[Any]) -> RuleFacts:
        known: dict[str, Any] = {name: _tuples(value) if name in _TUPLES else value for name, value in facts.items()}
        most, on, wait_s = retries
        digests = {file: self._files[number] for file, number in code.items()}
        return RuleFacts(code=digests, sources=dict(sources), retries=Retries(most, tuple(on), wait_s), **known)


def _tuples(value: list[Any]) -> tuple[Any, ...]:
    return tuple(tuple(one) if isinstance(one, list) else one for one in value)
