"""When bytes are gone that a node reads: find whose output they were, and let that be fetched, or run, again.

A cache entry is trusted by the sizes of its blobs, so damage inside a blob shows only when somebody reads it. And a
result may be bare: known, without its bytes, until somebody reads them. In both cases the reader goes back to waiting,
and what made its inputs is looked up anew.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from dextera_build.engine.expand import Wiring
from dextera_build.engine.states import State
from dextera_build.engine.units import Gathering, Node, States, Unit
from dextera_build.store.store import Store

_MOST = 3
"""How often one blob may vanish under one reader."""


def rewind(unit: Unit, digest: str, store: Store, states: States) -> list[Unit] | None:
    """Blob `digest` is gone: take `unit`, and all between it and nodes whose results are lost, back to waiting.

    Returns:
        The units that must be connected again, or None where nothing that `unit` reads can be made again. A node itself
        can: what it wrote may have met damaged bytes of the same name.
    """
    unit.lost = unit.lost or Counter()
    unit.lost[digest] += 1
    if unit.lost[digest] > _MOST:
        return None
    again = _above(unit, lambda source: _gone(source, store))
    return _back(unit, again, states) if again or isinstance(unit, Node) else None


def absent(node: Node, store: Store, wiring: Wiring) -> list[Node]:
    """Nodes whose results are bare, and of which `node`, all of whose inputs are known, reads bytes that are absent."""
    found: dict[Node, None] = {}
    for slot, source in node.call.inputs.items():
        bare = [maker for maker in _makers(wiring.sources(source, node)) if maker.bare]
        if not bare:
            continue
        given = node.inputs.get(slot) or wiring.value(source, node)  # in a dry run inputs are not held
        if not store.actions.references.are_here(given):
            found |= dict.fromkeys(maker for maker in bare if not _is_here(maker, store))
    return list(found)


def send_back(unit: Unit, missing: Iterable[Node], states: States) -> list[Unit]:
    """Take `unit`, and all between it and these nodes that it reads, back to waiting; they must be connected again."""
    wanted = {id(node) for node in missing}
    return _back(unit, _above(unit, lambda source: id(source) in wanted), states)


def _makers(units: Iterable[Unit]) -> Iterator[Node]:
    """The nodes whose bytes come from these units: not those that only said which copies a group has."""
    stack = [*units]
    while stack:
        source = stack.pop()
        if isinstance(source, Node):
            yield source
        elif isinstance(source, Gathering):
            stack += source.nodes.values()
        else:
            stack += source.sources


def _is_here(node: Node, store: Store) -> bool:
    return node.output is not None and store.actions.references.are_here(node.output)


def _above(unit: Unit, gone: Callable[[Unit], bool]) -> list[Unit]:
    """What `unit` reads and is gone, with all openings and gatherings on the way; nothing where nothing is gone.

    A source that is gone may be on its way already; then only its readers must wait for it again.
    """
    found: list[Unit] = []
    any_gone = False
    seen = {id(unit)}
    stack = list(unit.sources)
    while stack:
        source = stack.pop()
        if id(source) in seen:
            continue
        seen.add(id(source))
        is_gone, is_node = gone(source), isinstance(source, Node)
        any_gone |= is_gone
        if is_gone or not is_node:
            found.append(source)
        if not is_node:
            stack += source.sources
    return [source for source in found if source.state is State.DONE] if any_gone else []


def _gone(source: Unit, store: Store) -> bool:
    if isinstance(source, Node):
        return source.key is None or store.actions.get(source.key) is None
    if isinstance(source, Gathering) and source.output is not None:
        return not store.blobs.has(source.output)
    return False


def _back(unit: Unit, again: list[Unit], states: States) -> list[Unit]:
    for other in (*again, unit):
        other.forget()
        if other.state is not State.WAITS:
            states.set(other, State.WAITS)
    return [unit, *again]
