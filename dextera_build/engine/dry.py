"""What a build would do, without running anything."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from dextera_build.engine.expand import Wiring
from dextera_build.engine.graph import Address, Graph, RuleFacts, parse_address
from dextera_build.engine.lookup import copy_of, leaves, lookup, reach
from dextera_build.engine.policy import Policy
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import Node, Path
from dextera_build.runs.history import History
from dextera_build.store.store import Store


@dataclass(frozen=True, slots=True)
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
    rule: RuleFacts = field(repr=False, compare=False)
    """Of its call."""
    output: str | None = None
    """Digest of the output of a cached node."""
    bare: bool = False
    """Its result is known, its bytes are absent: cached as long as nobody needs them, stale where somebody does."""
    spell: Callable[[], bytes] = field(default=bytes, repr=False, compare=False)

    @property
    def key_document(self) -> bytes:
        """The key document of a cached or stale node, spelled anew each time."""
        return self.spell()


def plan(
    graph: Graph, targets: Sequence[Address | tuple[str, ...]], store: Store, *, history: History | None = None
) -> list[Planned]:
    """What a build of `targets` would do with each node that they need, in the order of the recipe.

    Raises:
        UsageError: A target names nothing.
        RecipeError: A file or folder is missing or cannot be read.
    """
    wanted = [target if isinstance(target, Address) else Address(target) for target in targets]
    for target in wanted:
        lookup(graph, target)
    scheduler = Scheduler(graph, store, None, Policy(keep_going=True, dry=True))
    scheduler.run(wanted)
    for error in scheduler.wiring.unread:
        raise error
    for unit, error in zip(scheduler.failed, scheduler.errors, strict=True):
        if unit in scheduler.wishes:
            raise error
    if scheduler.wiring.openings:  # what copies read of a group that is not open yet
        for leaf in leaves(graph, wanted):
            scheduler.wiring.leaf(leaf)
    store.leaves.save()
    return [
        _planned(entry, scheduler, history) if isinstance(entry, Node) else _open(graph, entry, history)
        for entry in _entries(graph, wanted, scheduler.wiring)
    ]


def _planned(node: Node, scheduler: Scheduler, history: History | None) -> Planned:
    spell = partial(scheduler.reading.document, node)
    if node.state is State.DONE:
        stale = node.bare and node.asked
        return Planned(
            node.address,
            "stale" if stale else "cached",
            node.key,
            node.result.seconds if node.result else None,
            node.rule,
            output=None if stale else node.output,
            bare=node.bare,
            spell=spell,
        )
    last = history.get(node.address) if history else None
    seconds = last.seconds if last else None
    if node.state is not State.STALE:
        return Planned(node.address, "unknown", None, seconds, node.rule)
    if node.rule.discovers:
        scheduler.reading.suppose(node, last.key if last else "")
    return Planned(node.address, "stale", node.key, seconds, node.rule, bare=node.bare, spell=spell)


def _entries(graph: Graph, wanted: Sequence[Address], wiring: Wiring) -> Iterator[Node | Path]:
    """Nodes, and calls whose copies are not known yet, in the order of the recipe."""
    copies: dict[Path, list[Node]] = {}
    for node in wiring.nodes.values():
        if node.labels:
            copies.setdefault(node.path, []).append(node)
    # Where no group is needed each call is one node, so that the graph need not be walked once more.
    reached = set(reach(graph, wanted)) if wiring.openings else set()
    for name in graph.members:
        if name in wiring.nodes:
            yield wiring.nodes[name]
        elif reached:
            for path, _ in graph.below(name):
                if path in copies:
                    yield from copies[path]
                elif path in reached:
                    yield path


def _open(graph: Graph, path: Path, history: History | None) -> Planned:
    name = ".".join(path)
    known = history.all() if history else {}
    past = [entry.seconds for address, entry in known.items() if parse_address(address).call == path]
    return Planned(name, "unknown", None, sum(past) if past else None, copy_of(graph, path, ()).rule)
