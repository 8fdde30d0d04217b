"""Recovers missing input bytes: finds the node that produced them and fetches or runs it again.

A cache entry is checked by the sizes of its blobs, so damage inside a blob shows only when the blob is read. A result
may also be bare: known, but without its bytes until they are needed. In both cases the reader goes back to waiting,
and the producers of its inputs are looked up again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from dextera_build.engine.expand import Wiring
from dextera_build.engine.states import State
from dextera_build.engine.units import Gathering, Node, States, Unit
from dextera_build.store.store import Store

_MOST = 3
"""How often the same blob may go missing for one reader."""


def rewind(unit: Unit, digest: str, store: Store, states: States) -> list[Unit] | None:
    """Blob `digest` is gone: reset `unit`, and all units between it and nodes with lost results, to waiting.

    Returns:
        The units to reconnect, or None if no source of `unit` can be rebuilt. A node itself can always run again: its
        output may have met a damaged blob of the same digest.
    """
    unit.lost = unit.lost or Counter()
    unit.lost[digest] += 1
    if unit.lost[digest] > _MOST:
        return None
    again = _above(unit, lambda source: _gone(source, store))
    return _back(unit, again, states) if again or isinstance(unit, Node) else None


def absent(node: Node, store: Store, wiring: Wiring) -> list[Node]:
    """Nodes with bare results whose absent bytes `node`, with all inputs known, needs to read."""
    found: dict[Node, None] = {}
    inputs = node.inputs or wiring.values(node)  # a dry run does not keep inputs
    for slot, source in node.call.inputs.items():
        bare = [maker for maker in _makers(wiring.sources(source, node)) if maker.bare]
        if not bare:
            continue
        given = inputs.get(slot)
        if given is not None and not store.actions.references.are_here(given):
            found |= dict.fromkeys(maker for maker in bare if not _is_here(maker, store))
    return list(found)


def send_back(unit: Unit, missing: Iterable[Node], states: States) -> list[Unit]:
    """Reset `unit`, and all units between it and the `missing` nodes, to waiting; returns those to reconnect."""
    wanted = {id(node) for node in missing}
    return _back(unit, _above(unit, lambda source: id(source) in wanted), states)


def _makers(units: Iterable[Unit]) -> Iterator[Node]:
    """The nodes that produced the bytes of these units, without those that only determine a group's copies."""
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
    """The missing sources of `unit`, with all openings and gatherings on the way; empty if none is missing.

    A missing source may already be on its way; then only its readers must wait for it again.
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
