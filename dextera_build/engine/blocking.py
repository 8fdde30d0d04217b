"""Effect of a lost unit on those that wait for it: most are blocked, lenient collections continue without it."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.engine.graph import Graph
from dextera_build.engine.states import LOST, State
from dextera_build.engine.units import Gathering, States, Unit


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
