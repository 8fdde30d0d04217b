"""Which calls some targets need, as far as the graph alone can tell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path as FilePath

from dextera_build.engine.graph import (
    Address,
    Call,
    Fixed,
    Gather,
    Graph,
    Group,
    Leaf,
    Output,
    Pack,
    node_address,
    parts_of,
)
from dextera_build.errors import UsageError, did_you_mean, listing

Path = tuple[str, ...]


def walk(graph: Graph, targets: Sequence[Address]) -> Iterator[tuple[Path, list[Call]]]:
    """Every call that `targets` may need, in the order in which they are met: its address without labels; `variants`.

    Raises:
        UsageError: A target names no call.
    """
    for target in targets:
        lookup(graph, target)
    seen: set[Path | str] = set()
    stack = [target.call for target in reversed(targets)]
    while stack:
        path = stack.pop()
        name = path if len(path) > 1 else path[0]  # most stand at the root, and a tuple around each shows
        if name in seen:
            continue
        seen.add(name)
        groups, call = _descend(graph, path)
        stack += needs(graph, path)
        yield path, variants(groups, call)


def needs(graph: Graph, path: Path) -> Iterator[Path]:
    """The calls that some copy of the call at `path` reads, and those whose collections its groups open over."""
    groups, call = _descend(graph, path)
    sources = [
        part for variant in variants(groups, call) for given in variant.inputs.values() for part in parts_of(given)
    ]
    for source in (*(group.over for group in groups), *sources):
        if isinstance(source, Output | Gather):
            yield source.call


def reach(graph: Graph, targets: Sequence[Address]) -> list[Path]:
    """The addresses of every call that `targets` may need, in the order in which they are met.

    Raises:
        UsageError: A target names no call.
    """
    return [path for path, _ in walk(graph, targets)]


def leaves(graph: Graph, targets: Sequence[Address]) -> Iterator[Leaf]:
    """Every file and folder that `targets` may need."""
    for _, calls in walk(graph, targets):
        yield from leaves_of(calls)


def leaves_of(calls: Iterable[Call]) -> Iterator[Leaf]:
    """Every file and folder that some calls read."""
    for call in calls:
        for source in call.inputs.values():
            yield from (part for part in parts_of(source) if isinstance(part, Leaf))


def files_read(call: Call) -> dict[str, FilePath]:
    """The slots that read a file or folder, `slot[label]` for those that list several."""
    found = {}
    for slot, source in call.inputs.items():
        parts = source.parts if isinstance(source, Pack) else {"": source}
        for label, part in parts.items():
            if isinstance(part, Leaf):
                found[f"{slot}[{label}]" if label else slot] = part.path
    return found


def variants(groups: Sequence[Group], call: Call) -> list[Call]:
    """A call and what replaces it in some copies of its group."""
    replaced = (
        [members[call.name] for members in groups[-1].overrides.values() if call.name in members] if groups else []
    )
    return [call, *replaced]


def copy_of(graph: Graph, path: Path, labels: tuple[str, ...]) -> Call:
    """The call that stands at `path` in the copy with these labels."""
    if len(path) == 1 and isinstance(call := graph.members[path[0]], Call):
        return call
    groups, call = _descend(graph, path)
    return groups[-1].overrides.get(labels[-1], {}).get(call.name, call) if groups and labels else call


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
        UsageError: There is none, or a group that lists its copies does not have this one.
    """
    try:
        groups, call = _descend(graph, target.call)
    except KeyError:
        known = [".".join(path) for path, _ in graph.calls()]
        name = ".".join(target.call)
        raise UsageError(
            f"`{target}` names no node of `{graph.name}`",
            code="DXB-U202",
            facts={"nodes": listing(known)},
            hint=did_you_mean(name, known),
        ) from None
    labels = target.labels or ()
    for depth, (group, label) in enumerate(zip(groups, labels, strict=False)):
        if isinstance(group.over, Fixed) and label not in group.over.labels:
            raise no_copy(str(target), node_address(target.call[: depth + 1], labels[:depth]), label, group.over.labels)
    return call


def no_copy(target: str, group: str, label: str, known: Iterable[str]) -> UsageError:
    """What to say where `target` names a copy that `group` does not have."""
    return UsageError(
        f"`{target}`: there is no `{label}` in `{group}`",
        code="DXB-U203",
        facts={"copies": listing(known)},
        hint=did_you_mean(label, known),
    )


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
