"""When bytes are gone that a node reads: find whose output they were, and let that run again.

A cache entry is trusted by the sizes of its blobs, so damage inside a blob shows only when somebody reads it. The
reader then goes back to waiting, and what made its inputs is looked up anew: entries whose blobs are gone are misses.
"""

from __future__ import annotations

from collections import Counter

from dextera_build.engine.states import State, States
from dextera_build.engine.units import Gathering, Node, Opening, Packing, Unit
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
    again = _lost(unit, store)
    if not again and not isinstance(unit, Node):
        return None
    for other in [*again, unit]:
        _back(other, states)
    return [unit, *again]


def _lost(unit: Unit, store: Store) -> list[Unit]:
    """Known sources of `unit`, through openings and gatherings, that are no longer whole, readers first."""
    order: list[Unit] = []
    seen = {id(unit)}
    stack = list(unit.sources)
    while stack:
        source = stack.pop()
        if id(source) not in seen:
            seen.add(id(source))
            order.append(source)
            if not isinstance(source, Node):
                stack += source.sources
    broken: set[int] = set()
    # A source stands after every reader of it that is not a node, so backwards each is judged before its readers.
    for source in _readers_last(order):
        if source.state is State.DONE and (_gone(source, store) or any(id(s) in broken for s in source.sources)):
            broken.add(id(source))
    return [source for source in order if id(source) in broken]


def _readers_last(order: list[Unit]) -> list[Unit]:
    nodes = [unit for unit in order if isinstance(unit, Node)]
    openings = [unit for unit in order if isinstance(unit, Opening)]
    gatherings = [unit for unit in order if isinstance(unit, Gathering)]
    packings = [unit for unit in order if isinstance(unit, Packing)]
    return [*nodes, *sorted(openings, key=lambda unit: len(unit.path)), *gatherings, *packings]


def _gone(source: Unit, store: Store) -> bool:
    if isinstance(source, Node):
        return source.key is None or store.actions.get(source.key) is None
    if isinstance(source, Gathering | Packing) and source.output is not None:
        return not store.blobs.has(source.output)
    return False


def _back(unit: Unit, states: States) -> None:
    unit.forget()
    if unit.state is not State.WAITS:
        states.set(unit, State.WAITS)
