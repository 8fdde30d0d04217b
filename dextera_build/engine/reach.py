"""Which calls some targets need, as far as the graph alone can tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dextera_build.engine.graph import Address, Call, Fixed, Gather, Graph, Group, Item, Leaf, Output, parts_of
from dextera_build.errors import UsageError, did_you_mean, listing

Path = tuple[str, ...]


def reach(graph: Graph, targets: Sequence[Address]) -> dict[Path, Call]:
    """Every call that `targets` may need, by its address without labels, in the order in which they are met.

    Raises:
        UsageError: A target names no call.
    """
    found: dict[Path, Call] = {}
    stack = [target.call for target in reversed(targets)]
    for target in targets:
        lookup(graph, target)
    while stack:
        path = stack.pop()
        if path in found:
            continue
        groups, call = _descend(graph, path)
        found[path] = call
        for group in groups:
            stack += _read_by(group.over)
        for variant in variants(groups, call):
            for source in variant.inputs.values():
                for part in parts_of(source):
                    stack += _read_by(part)
    return found


def leaves(graph: Graph, targets: Sequence[Address]) -> Iterator[Leaf]:
    """Every file and folder that `targets` may need."""
    for path, call in reach(graph, targets).items():
        groups, _ = _descend(graph, path)
        for variant in variants(groups, call):
            read = (part for source in variant.inputs.values() for part in parts_of(source))
            yield from (part for part in read if isinstance(part, Leaf))


def variants(groups: Sequence[Group], call: Call) -> list[Call]:
    """A call and what replaces it in some copies of its group."""
    replaced = (
        [members[call.name] for members in groups[-1].overrides.values() if call.name in members] if groups else []
    )
    return [call, *replaced]


def copy_of(graph: Graph, path: Path, labels: tuple[str, ...]) -> Call:
    """The call that stands at `path` in the copy with these labels."""
    groups, call = _descend(graph, path)
    if groups and labels:
        return groups[-1].overrides.get(labels[-1], {}).get(call.name, call)
    return call


def group_at(graph: Graph, path: Path) -> Group:
    """The group at `path`."""
    members = graph.members
    for name in path[:-1]:
        outer = members[name]
        assert isinstance(outer, Group), f"{path} leads through a call"
        members = outer.members
    group = members[path[-1]]
    assert isinstance(group, Group), f"{path} is a call"
    return group


def lookup(graph: Graph, target: Address) -> Call:
    """The call that a target names.

    Raises:
        UsageError: There is none.
    """
    try:
        return _descend(graph, target.call)[1]
    except KeyError:
        known = [".".join(path) for path, _ in graph.calls()]
        name = ".".join(target.call)
        raise UsageError(
            f"`{target}` names no node of `{graph.name}`",
            code="DXB-U202",
            facts={"nodes": listing(known)},
            hint=did_you_mean(name, known),
        ) from None


def _descend(graph: Graph, path: Path) -> tuple[list[Group], Call]:
    groups: list[Group] = []
    members = graph.members
    for name in path[:-1]:
        member = members[name]
        if isinstance(member, Call):
            raise KeyError(path)
        groups.append(member)
        members = member.members
    call = members[path[-1]]
    if not isinstance(call, Call):
        raise KeyError(path)
    return groups, call


def _read_by(source: object) -> list[Path]:
    if isinstance(source, Output | Gather):
        return [source.call]
    assert isinstance(source, Leaf | Item | Fixed)
    return []
