"""Finds the code that runs an input: companions of the rules that made it, through the whole graph."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, get_args

from dextera_build.code.companions import Companion, Companions, beside, in_folder
from dextera_build.code.loader import Library, RuleFile
from dextera_build.engine.graph import (
    Call,
    Fixed,
    Gather,
    Graph,
    Group,
    Input,
    Item,
    Names,
    Output,
    RuleFacts,
    parts_of,
)
from dextera_build.errors import RecipeError, listing
from dextera_build.recipe.kinds import overlap, parameters


def joined(graph: Graph, library: Library, join: Callable[[RuleFacts, Companions], RuleFacts]) -> Graph:
    """The graph whose calls know the code that runs their inputs.

    Args:
        graph: Every call, without cycles.
        library: Provides rules.
        join: Adds companions to the facts of a rule.

    Raises:
        RecipeError: The rule that made such an input has no companion, or two folders with one have the same name.
    """
    trace = _Trace(graph, library)

    def of_call(path: Names, call: Call, label: str | None = None) -> Call:
        found = trace.companions(path, call, label)
        return replace(call, rule=join(call.rule, found)) if found else call

    def of_member(path: Names, member: Call | Group) -> Call | Group:
        if isinstance(member, Call):
            return of_call(path, member)
        overrides = {
            label: {name: of_call((*path, name), call, label) for name, call in calls.items()}
            for label, calls in member.overrides.items()
        }
        return replace(member, members=of_members(path, member.members), overrides=overrides)

    def of_members(path: Names, members: Mapping[str, Call | Group]) -> dict[str, Call | Group]:
        return {name: of_member((*path, name), member) for name, member in members.items()}

    return replace(graph, members=of_members((), graph.members))


class _Trace:
    """Follows inputs to the rules that made them.

    Args:
        graph: Every call, without cycles.
        library: Provides rules.
    """

    def __init__(self, graph: Graph, library: Library) -> None:
        self._graph, self._library = graph, library

    def companions(self, path: Names, call: Call, label: str | None) -> Companions:
        """The companions of the inputs of a call at `path`; `label` is that of its copy if there is only one."""
        declared = self._library.find(call.rule.path).rule.runs
        found: dict[str, list[Companion]] = {}
        named: dict[tuple[str, str], Companion] = {}
        for slot in sorted(declared.keys() & call.inputs.keys()):
            for each in self._run(path, call, label, slot, declared[slot]):
                known = named.setdefault((each.name, each.file.name), each)
                if known.file != each.file:
                    raise RecipeError(
                        f"two folders called `{each.name}` hold companions of the inputs of `{call.rule.path}`",
                        code="DXB-R215",
                        where=call.where,
                        facts={"files": listing(sorted(map(str, (known.file, each.file))))},
                        hint="rename one of the folders, and the names that its rules take from it",
                    )
                found.setdefault(slot, []).append(known)
        return found

    def _run(self, path: Names, call: Call, label: str | None, slot: str, stems: Sequence[str]) -> list[Companion]:
        """The companions of the artifacts that a slot may carry, by path."""
        kind = self._library.find(call.rule.path).rule.slots[slot].annotation
        kind = (*parameters(kind), kind)[0]
        found: dict[str, Companion] = {}
        seen: set[int] = set()
        stack = [(path, label, call.inputs[slot])]
        while stack:
            for place, copy, maker in self._makers(*stack.pop()):
                if id(maker) in seen:
                    continue
                seen.add(id(maker))
                rule = self._library.find(maker.rule.path)
                slots = rule.rule.slots
                passed = [given for name, given in maker.inputs.items() if holds(slots[name].annotation, kind)]
                for companion in (self._of_maker(rule, maker, stem) for stem in stems):
                    self._library.asked.add(str(companion.file))
                    if companion.file.is_file():
                        found[companion.path] = companion
                    elif not passed:
                        raise _nothing_runs(call, slot, rule.path, companion)
                stack += [(place, copy, given) for given in passed]
        return [found[name] for name in sorted(found)]

    def _of_maker(self, rule: RuleFile, maker: Call, stem: str) -> Companion:
        """The companion in the folder that an option of the maker names, or in the folder of its rule."""
        for option, folder in rule.rule.folders.items():
            return in_folder(self._library, f"{folder}/{maker.options[option]}", stem)
        return beside(rule, stem)

    def _makers(self, place: Names, label: str | None, source: Input) -> Iterator[tuple[Names, str | None, Call]]:
        """The calls that make an input of the call or group at `place`, with their address and label."""
        for part in parts_of(source):
            if isinstance(part, Item):
                over = self._graph.group(part.group).over
                yield from () if isinstance(over, Fixed) else self._makers(part.group, None, over)
            elif isinstance(part, Output) and label is not None and part.call[:-1] == place[:-1]:
                yield part.call, label, self._graph.copy(part.call, (label,))
            elif isinstance(part, Output | Gather):
                yield from ((part.call, None, call) for call in self._graph.variants(part.call))


def holds(kind: Any, wanted: Any) -> bool:
    """Whether a value of type `kind` is, or may hold, an artifact of type `wanted`."""
    return any(_model_holds(model, wanted) for model in _models(kind))


@lru_cache(maxsize=4096)
def _model_holds(model: Any, wanted: Any) -> bool:
    """As `holds`, kept, as a plan asks it of the same types hundreds of times."""
    seen, stack = {model}, [model]
    while stack:
        here = stack.pop()
        if overlap(here, wanted):
            return True
        inner = {each for field in here.model_fields.values() for each in _models(field.annotation)} - seen
        seen |= inner
        stack += inner
    return False


def _models(kind: Any) -> Iterator[Any]:
    """The models that a type names."""
    if isinstance(kind, type) and hasattr(kind, "model_fields"):
        yield kind
    else:
        for inner in get_args(kind):
            yield from _models(inner)


def _nothing_runs(call: Call, slot: str, maker: str, companion: Companion) -> RecipeError:
    where = "next to it" if companion.of == maker else f"in `{companion.of}`"
    return RecipeError(
        f"`{call.rule.path}` runs the result of `{maker}`, which has no `{companion.file.name}` {where}",
        code="DXB-R216",
        where=call.where,
        facts={"input": slot, "looked for": str(companion.file)},
        hint=f"write `{companion.file.name}` there",
    )
