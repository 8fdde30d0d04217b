"""Every node that targets need, as it stands in the store, without running anything."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from dextera_build.bundle.config import Build, Closure
from dextera_build.bundle.config import Node as Entry
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.lookup import files_read, leaves
from dextera_build.engine.policy import Policy
from dextera_build.engine.schedule import Scheduler
from dextera_build.engine.states import State
from dextera_build.engine.units import producers
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store


@dataclass(frozen=True)
class Held:
    """One node whose result is in the store, with its bytes where these were asked for."""

    address: str
    rule: str
    backend: str | None
    key: str
    result: ActionResult
    depends_on: tuple[str, ...]
    """Nodes whose outputs it reads, directly or through groups."""
    files: dict[str, Path]
    """Slot, or `slot[label]` -> project file or folder."""


@dataclass(frozen=True)
class Survey:
    """What the store holds for some targets."""

    targets: tuple[str, ...]
    """Nodes that were asked for, every copy by itself."""
    nodes: tuple[Held, ...]
    stale: tuple[str, ...]
    """Nodes that a build would run or fetch, or that wait for one."""


def survey(graph: Graph, wanted: Sequence[Address], store: Store, *, whole: bool = False) -> Survey:
    """Look at every node that `wanted` need; of those that they name, or with `whole` of all, the bytes must be there.

    Raises:
        UsageError: A target names nothing.
        RecipeError: A file or folder is missing or cannot be read.
    """
    scheduler = Scheduler(graph, store, None, Policy(keep_going=True, dry=True, whole=whole))
    for leaf in leaves(graph, wanted):
        scheduler.wiring.leaf(leaf)
    scheduler.run(list(wanted))
    store.leaves.save()
    for unit, error in zip(scheduler.failed, scheduler.errors, strict=True):
        if unit in scheduler.wishes:
            raise error
    held, stale = [], []
    for node in scheduler.wiring.nodes.values():
        lacks_bytes = node.bare and node.asked
        if node.state is not State.DONE or node.key is None or node.result is None or lacks_bytes:
            stale.append(node.address)
            continue
        rule, reads = node.rule, tuple(dict.fromkeys(other.address for other in producers(node)))
        files = files_read(node.call)
        held.append(Held(node.address, rule.path, rule.backend, node.key, node.result, reads, files))
    complete = all(wish.state is State.DONE for wish in scheduler.wishes)
    if not complete and not stale:
        stale = [wish.address for wish in scheduler.wishes if wish.state is not State.DONE]
    return Survey(tuple(dict.fromkeys(scheduler.wiring.asked())), tuple(held), tuple(stale))


def as_build(found: Survey, recipe: str, profile: str, closure: Closure, shown: Callable[[Path], str]) -> Build:
    """A survey without stale nodes as a bundle says it.

    Args:
        found: The nodes.
        recipe: Address of the recipe.
        profile: The profile that it was planned with.
        closure: Of which nodes the bytes shall be there.
        shown: A project file's path as others may see it.
    """
    whole = {node.key for node in found.nodes if closure == "full" or node.address in found.targets}
    nodes = tuple(
        Entry(
            node=node.address,
            rule=node.rule,
            backend=node.backend,
            key=node.key,
            output=node.result.output,
            result=node.result.digest,
            is_whole=node.key in whole,
            seconds=node.result.seconds,
            depends_on=node.depends_on,
            files={slot: shown(path) for slot, path in node.files.items()},
        )
        for node in sorted(found.nodes, key=lambda node: node.address)
    )
    return Build(recipe, found.targets, profile, nodes)
