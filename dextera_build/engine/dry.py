"""Effect of a build, without running anything."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

from dextera_build.engine.graph import Address, Call, Graph, RuleFacts, parse_address
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import Node, Path
from dextera_build.errors import UsageError
from dextera_build.runs.history import History
from dextera_build.store.store import Store


@dataclass(frozen=True, slots=True)
class Planned:
    """Effect of a build on one node."""

    address: str
    """`body[mug].mesh`; `body.mesh` for copies that are not known yet."""
    status: Literal["cached", "stale", "unknown"]
    """`stale`: it would run. `unknown`: an input is stale, but its output may turn out unchanged."""
    key: str | None
    """None if unknown; with discovered inputs, a stale node's key is predicted from the files its last run read."""
    seconds_last: float | None
    """Duration of its last run [s], if known."""
    rule: RuleFacts = field(repr=False, compare=False)
    """The rule of its call."""
    output: str | None = None
    """Digest of the output of a cached node."""
    bare: bool = False
    """Its result is known but its bytes are absent: cached unless a node or target needs them, stale otherwise."""
    spell: Callable[[], bytes] = field(default=bytes, repr=False, compare=False)

    @property
    def key_document(self) -> bytes:
        """The key document of a cached or stale node, rebuilt on each access."""
        return self.spell()


def survey(
    graph: Graph, targets: Sequence[Address], store: Store, *, whole: bool = False
) -> tuple[Scheduler, list[Path]]:
    """Look up every node that `targets` need; returns the scheduler and the calls that they may need.

    Raises:
        UsageError: A target or a setting names a copy that its group does not have.
        RecipeError: A file or folder is missing or cannot be read.
    """
    scheduler = Scheduler(graph, store, None, RunPolicy(keep_going=True, dry=True, whole=whole))
    calls = scheduler.wiring.look(targets)
    scheduler.run(targets)
    for unit, error in zip(scheduler.failed, scheduler.errors, strict=True):
        if unit in scheduler.wiring.wishes or isinstance(error, UsageError):
            raise error
    store.leaves.save()
    return scheduler, calls


def plan(
    graph: Graph, targets: Sequence[Address | tuple[str, ...]], store: Store, *, history: History | None = None
) -> list[Planned]:
    """Effect of a build of `targets` on each node they need, in recipe order; see `survey`."""
    wanted = [target if isinstance(target, Address) else Address(target) for target in targets]
    scheduler, calls = survey(graph, wanted, store)
    nodes: dict[Path, list[Node]] = {}
    for node in scheduler.wiring.nodes.values():
        nodes.setdefault(node.path, []).append(node)
    needed, found = set(calls), list[Planned]()
    for path, call in graph.calls():
        if path in nodes:
            found += [_planned(node, scheduler, history) for node in nodes[path]]
        elif path in needed:
            found.append(_unopened(path, call, history))
    return found


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


def _unopened(path: Path, call: Call, history: History | None) -> Planned:
    """The entry for copies that are not known yet."""
    known = history.all() if history else {}
    past = [entry.seconds for address, entry in known.items() if parse_address(address).call == path]
    return Planned(".".join(path), "unknown", None, sum(past) if past else None, call.rule)
