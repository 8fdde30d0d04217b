"""Effect of a lost unit on those that wait for it: most are blocked, lenient collections continue without it."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.engine.graph import Graph, OnFailure
from dextera_build.engine.states import LOST, State
from dextera_build.engine.units import Gathering, Node, States, Unit


def consequence(unit: Unit, graph: Graph) -> OnFailure:
    """Effect of a failure of `unit` on the run, by its own call and the groups around it; the mildest counts."""
    said = {graph.group(unit.path[:depth]).on_failure for depth in range(1, len(unit.path))}
    if isinstance(unit, Node):
        said.add(unit.call.on_failure)
    return "leave_out" if "leave_out" in said else "go_on" if "go_on" in said else "stop"


def can_do_without(unit: Unit, sources: Sequence[Unit], graph: Graph) -> bool:
    """Whether a gathering leaves out all `sources` that are lost; without such sources, any unit can."""
    for source in [source for source in sources if source.state in LOST]:
        if not (isinstance(unit, Gathering) and graph.is_lenient(source.path, len(unit.labels))):
            return False
        unit.leave_out(source)
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
