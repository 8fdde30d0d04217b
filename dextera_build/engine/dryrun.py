"""What a build would do, without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from dextera_build.engine.graph import Address, Graph, parse_address
from dextera_build.engine.history import History
from dextera_build.engine.policy import Policy
from dextera_build.engine.reach import leaves, reach
from dextera_build.engine.reading import Reading
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import Node
from dextera_build.store.store import Store


@dataclass(frozen=True)
class Planned:
    """What a build would do with one node."""

    address: str
    """`body[mug].mesh`; `body.mesh` stands for copies that are not known yet."""
    status: Literal["cached", "stale", "unknown"]
    """`stale`: it would run. `unknown`: it reads something that is stale, whose output may come out equal."""
    key: str | None
    """None where it is not known; that of a stale node which reads by itself is right if it reads what it read last."""
    seconds_last: float | None
    """How long it ran the last time [s], where that is known."""
    output: str | None = None
    """Digest of the output of a cached node."""
    key_document: bytes = field(default=b"", repr=False)
    """The key document of a cached or stale node."""
    bare: bool = False
    """Its result is known, its bytes are absent: cached as long as nobody needs them, stale where somebody does."""


def plan(
    graph: Graph, targets: Sequence[Address | tuple[str, ...]], store: Store, *, history: History | None = None
) -> list[Planned]:
    """What a build of `targets` would do with each node that they need, in the order of the recipe.

    Raises:
        UsageError: A target names nothing.
        RecipeError: A file or folder is missing or cannot be read.
    """
    wanted = [target if isinstance(target, Address) else Address(target) for target in targets]
    scheduler = Scheduler(graph, store, None, Policy(keep_going=True, dry=True))
    for leaf in leaves(graph, wanted):
        scheduler.wiring.leaf(leaf)
    scheduler.run(wanted)
    store.leaves.save()
    for unit, error in zip(scheduler.failed, scheduler.errors, strict=True):
        if unit in scheduler.wishes:
            raise error
    copies: dict[tuple[str, ...], list[Node]] = {path: [] for path in reach(graph, wanted)}
    for node in scheduler.wiring.nodes.values():
        copies[node.path].append(node)
    order = {path: place for place, (path, _) in enumerate(graph.calls())}
    found = []
    for path in sorted(copies, key=order.__getitem__):
        found += [_planned(node, history, scheduler.reading) for node in copies[path]] or [_open(path, history)]
    return found


def _planned(node: Node, history: History | None, reading: Reading) -> Planned:
    last = history.get(node.address) if history else None
    seconds = node.result.seconds if node.result else last.seconds if last else None
    if node.state is State.DONE and node.bare and node.asked:
        return Planned(node.address, "stale", node.key, seconds, None, node.document, bare=True)
    if node.state is State.DONE and node.result is not None:
        return Planned(node.address, "cached", node.key, seconds, node.result.output, node.document, node.bare)
    if node.state is State.STALE:
        reading.suppose(node, last.key if last else "")
        return Planned(node.address, "stale", node.key, seconds, None, node.document)
    return Planned(node.address, "unknown", None, seconds)


def _open(path: tuple[str, ...], history: History | None) -> Planned:
    name = ".".join(path)
    known = history.all() if history else {}
    past = [entry.seconds for address, entry in known.items() if parse_address(address).call == path]
    return Planned(name, "unknown", None, sum(past) if past else None)
