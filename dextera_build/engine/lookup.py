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
        UsageError: A target names a copy that its group does not have.
    """
    for target in targets:
        _check(graph, target)
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


def _check(graph: Graph, target: Address) -> None:
    """Refuse a copy that a group does not have which lists its copies."""
    labels = target.labels or ()
    for depth, (group, label) in enumerate(zip(_descend(graph, target.call)[0], labels, strict=False)):
        if isinstance(group.over, Fixed) and label not in group.over.labels:
            raise no_copy(str(target), node_address(target.call[: depth + 1], labels[:depth]), label, group.over.labels)


def no_copy(target: str, group: str, label: str, known: Iterable[str]) -> UsageError:
    """What to say where `target` names a copy that `group` does not have."""
    return UsageError(
        f"`{target}`: there is no `{label}` in `{group}`",
        code="DXB-U203",
        facts={"copies": listing(known)},
        hint=did_you_mean(label, known),
    )


def _descend(graph: Graph, path: Path) -> tuple[list[Group], Call]:
    groups = [group_at(graph, path[:depth]) for depth in range(1, len(path))]
    call = (groups[-1].members if groups else graph.members)[path[-1]]
    assert isinstance(call, Call), f"{path} is a group"
    return groups, call


def _read_by(source: object) -> list[Path]:
    return [source.call] if isinstance(source, Output | Gather) else []
