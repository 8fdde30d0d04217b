"""Finds every node that targets need in the store, without running anything."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dextera_build.bundle.config import Closure, Node
from dextera_build.engine import dry
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.states import State
from dextera_build.engine.units import producers
from dextera_build.store.store import Store


@dataclass(frozen=True)
class Survey:
    """The state of some targets in the store."""

    targets: tuple[str, ...]
    """The requested nodes, each copy separately."""
    nodes: tuple[Node, ...]
    """The nodes that are not stale, sorted."""
    stale: tuple[str, ...]
    """Nodes that a build would run or fetch, or that wait for one."""


def survey(
    graph: Graph,
    wanted: Sequence[Address],
    store: Store,
    closure: Closure = "targets",
    shown: Callable[[Path], str] = str,
) -> Survey:
    """Look up every node that some targets need.

    Args:
        graph: The plan.
        wanted: The targets.
        store: Where results are looked up.
        closure: Which nodes need their bytes in the store.
        shown: Formats the path of a project file for other readers.

    Raises:
        UsageError: A target does not exist.
        RecipeError: A file or folder is missing or cannot be read.
    """
    scheduler, _ = dry.survey(graph, wanted, store, whole=closure == "full")
    targets = tuple(dict.fromkeys(scheduler.wiring.asked))
    units = sorted(scheduler.wiring.nodes.values(), key=lambda unit: unit.address)
    # A node that shares its key with a target has its bytes, too.
    whole = {unit.key for unit in units if closure == "full" or unit.address in targets}
    nodes, stale = [], []
    for unit in units:
        lacks_bytes = unit.bare and unit.asked
        if unit.state is not State.DONE or unit.key is None or unit.result is None or lacks_bytes:
            stale.append(unit.address)
            continue
        nodes.append(
            Node(
                node=unit.address,
                rule=unit.rule.path,
                backend=unit.rule.backend,
                key=unit.key,
                output=unit.result.output,
                result=unit.result.digest,
                is_whole=unit.key in whole,
                seconds=unit.result.seconds,
                depends_on=tuple(dict.fromkeys(other.address for other in producers(unit))),
                files={slot: shown(path) for slot, path in unit.call.files().items()},
            )
        )
    if not stale:
        stale = [wish.address for wish in scheduler.wiring.wishes if wish.state is not State.DONE]
    return Survey(targets, tuple(nodes), tuple(stale))
