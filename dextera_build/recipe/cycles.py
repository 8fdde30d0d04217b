"""Refuses graphs that feed into themselves."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.engine.graph import Call, Fixed, Gather, Graph, Group, Input, Item, Output, parts_of
from dextera_build.errors import RecipeError

Address = tuple[str, ...]


def refuse(graph: Graph) -> None:
    """Walk the static graph once.

    Raises:
        RecipeError: There is a cycle; the message shows it from node to node.
    """
    calls = dict(graph.calls())
    groups = dict(_groups(graph))
    done: set[Address] = set()
    for start in calls:
        if start in done:
            continue
        trail: dict[Address, None] = {}
        stack: list[tuple[Address, Iterator[Address]]] = []
        _push(start, calls, groups, stack, trail)
        while stack:
            address, needs = stack[-1]
            following = next((need for need in needs if need not in done), None)
            if following is None:
                stack.pop()
                trail.popitem()
                done.add(address)
            elif following in trail:
                way = list(trail)
                loop = [*way[way.index(following) :], following]
                names = " -> ".join("`" + ".".join(part) + "`" for part in loop)
                raise RecipeError(
                    "the recipe feeds into itself",
                    code="DXB-R108",
                    where=calls[following].where,
                    facts={"cycle": names},
                )
            else:
                _push(following, calls, groups, stack, trail)


def _push(
    address: Address,
    calls: dict[Address, Call],
    groups: dict[Address, Group],
    stack: list[tuple[Address, Iterator[Address]]],
    trail: dict[Address, None],
) -> None:
    stack.append((address, _needs(address, calls, groups)))
    trail[address] = None


def _needs(address: Address, calls: dict[Address, Call], groups: dict[Address, Group]) -> Iterator[Address]:
    inputs: list[Input] = [part for source in calls[address].inputs.values() for part in parts_of(source)]
    # A copy exists only once its group's collection is known.
    opened = [groups[address[:depth]].over for depth in range(1, len(address))]
    inputs += [over for over in opened if not isinstance(over, Fixed)]
    for given in inputs:
        if isinstance(given, Output | Gather):
            yield given.call
        elif isinstance(given, Item):
            over = groups[given.group].over
            if isinstance(over, Output):
                yield over.call


def _groups(graph: Graph) -> Iterator[tuple[Address, Group]]:
    stack: list[tuple[Address, Call | Group]] = [((name,), member) for name, member in graph.members.items()]
    while stack:
        address, member = stack.pop()
        if isinstance(member, Group):
            yield address, member
            stack += [((*address, name), inner) for name, inner in member.members.items()]
