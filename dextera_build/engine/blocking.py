"""Effect of a lost unit on those that wait for it: most are blocked, lenient collections continue without it."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.engine.graph import Graph, OnFailure, Output, Pack, mildest, parts_of
from dextera_build.engine.states import LOST, State
from dextera_build.engine.units import Gathering, Node, States, Unit


def consequence(unit: Unit, graph: Graph) -> OnFailure:
    """Effect of a failure of `unit` on the run, by its own call and the groups around it; the mildest counts."""
    said = {graph.group(unit.path[:depth]).on_failure for depth in range(1, len(unit.path))}
    if isinstance(unit, Node):
        said.add(unit.call.on_failure)
    return mildest(said)


def can_do_without(unit: Unit, sources: Sequence[Unit], graph: Graph) -> bool:
    """Whether a unit leaves out all `sources` that are lost; without such sources, any unit can."""
    for source in [source for source in sources if source.state in LOST]:
        gathers = isinstance(unit, Gathering) and graph.is_lenient(source.path, len(unit.labels))
        if not (gathers or (isinstance(unit, Node) and _only_lists(unit, source))):
            return False
        unit.leave_out(source)
    return True


def _only_lists(unit: Node, lost: Unit) -> bool:
    """Whether a node reads a lenient call as an entry of listed collections alone, and other entries remain."""
    if not isinstance(lost, Node) or lost.call.on_failure == "stop":
        return False
    there = {source.path for source in unit.sources if source is not lost}
    for given in unit.call.inputs.values():
        named = [part.call if isinstance(part, Output) else None for part in parts_of(given)]
        others = isinstance(given, Pack) and any(name is None or name in there for name in named)
        if lost.path in named and not others:
            return False
    return True


def block_readers(unit: Unit, graph: Graph, states: States) -> None:
    """Block every unit that waits for a lost one, directly or not, and cannot do without it."""
    stack = [(unit, reader) for reader in unit.dependents]
    while stack:
        source, reader = stack.pop()
        if reader.state is not State.WAITS:
            continue
        if not can_do_without(reader, [source], graph):
            states.set(reader, State.BLOCKED)
            stack += [(reader, further) for further in reader.dependents]
        elif reader.pending == 0:
            states.set(reader, State.READY)
