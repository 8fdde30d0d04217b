"""Blobs are dropped at random: a build still returns what the reference returns, and runs no node that need not run."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from dextera_build.engine.dry import plan
from dextera_build.engine.graph import Address, Fixed, Gather, Input, Item, Leaf, Output, node_address
from dextera_build.store.entry import Entry
from dextera_build.store.headers import closure
from dextera_build.store.store import Store
from tests.engine.tiny import run
from tests.oracle.graphs import RandomGraph
from tests.oracle.reference import Labels, Reference

_STEPS = 4


@dataclass
class Before:
    """What a store held before a build."""

    blobs: set[str]
    entries: dict[str, Entry]

    @classmethod
    def of(cls, store: Store) -> Before:
        read = {key: store.actions.entry(key) for key in list(store.actions.keys())}
        return cls({digest for digest, _ in store.blobs.all()}, {key: entry for key, entry in read.items() if entry})

    def knows(self, key: str, output: str, reference: Reference) -> bool:
        """Whether the headers of a result and its key document are there."""
        return key in self.entries and self.blobs >= {key, output, *_headers(reference, output)}

    def holds(self, key: str, output: str, reference: Reference) -> bool:
        """Whether all of a result is there."""
        return key in self.entries and self.blobs >= {key, output, *_below(reference, output)}


def _below(reference: Reference, output: str) -> Iterator[str]:
    refs, blobs = closure(reference.store[output])
    yield from (*refs, *blobs)
    for ref in refs:
        yield from _below(reference, ref)


def _headers(reference: Reference, output: str) -> Iterator[str]:
    for ref in closure(reference.store[output])[0]:
        yield ref
        yield from _headers(reference, ref)


def _makers(reference: Reference, source: Input, scope: tuple[str, ...], labels: Labels) -> set[str]:
    """Addresses of the nodes whose bytes an input has."""
    if isinstance(source, Output):
        return {node_address(source.call, labels[: len(source.call) - 1])}
    if isinstance(source, Item):
        over = reference.member(source.group).over
        level = len(source.group)
        return set() if isinstance(over, Fixed) else _makers(reference, over, source.group[:-1], labels[: level - 1])
    if isinstance(source, Gather):
        shared = 0
        while shared < min(len(scope), len(source.call) - 1) and scope[shared] == source.call[shared]:
            shared += 1
        return {node_address(source.call, copy) for copy in reference.copies(source.call, labels[:shared]) or ()}
    return set()


def _must_run(reference: Reference, before: Before, keys: dict[str, str], targets: set[str]) -> set[str]:
    """Nodes that have to run: what is not known, targets without bytes, and what these lack of what they read."""
    places = {node_address(path, labels): (path, labels) for path, labels in _places(reference)}

    def lacks_bytes(address: str) -> bool:
        output = str(reference.outputs[address])
        return not before.blobs >= {output, *_below(reference, output)}

    must = {a for a, key in keys.items() if not before.knows(key, str(reference.outputs[a]), reference)}
    must |= {a for a in targets if not before.holds(keys[a], str(reference.outputs[a]), reference)}
    stack = list(must)
    while stack:
        path, labels = places[stack.pop()]
        for source in reference.call(path, labels).inputs.values():
            if isinstance(source, Leaf):
                continue
            value = str(reference.value(source, path[:-1], labels))
            whole = before.blobs >= {*([value] if not isinstance(source, Gather) else []), *_below(reference, value)}
            if not whole:
                fresh = {a for a in _makers(reference, source, path[:-1], labels) if lacks_bytes(a)} - must
                must |= fresh
                stack += fresh
    return must


def _places(reference: Reference) -> Iterator[tuple[tuple[str, ...], Labels]]:
    for path, _ in reference.graph.calls():
        yield from ((path, labels) for labels in reference.copies(path, ()) or ())


def _drop(store: Store, dice: random.Random, share: float) -> None:
    for digest, _ in list(store.blobs.all()):
        if dice.random() < share:
            store.blobs.path(digest).unlink()


@pytest.mark.parametrize("seed", range(60))
def test_what_runs_had_to_run(seed: int, tmp_path: Path) -> None:
    dice, random_graph, store = random.Random(seed), RandomGraph(seed, tmp_path), Store(tmp_path / "store")
    every = [Address(path) for path, _ in random_graph.graph().calls()]
    run(random_graph.graph(), store, *every)
    for step in range(_STEPS):
        _drop(store, dice, (0.05, 0.2, 0.5, 0.9)[step])
        graph, targets, before = random_graph.graph(), random_graph.targets(), Before.of(store)
        reference = Reference(graph, {})
        reference.build(targets)
        planned = plan(graph, targets, store)
        result, record = run(graph, store, *targets)

        assert result.ok
        assert {name: node.output for name, node in result.nodes.items()} == reference.outputs
        keys = {name: str(node.key) for name, node in result.nodes.items()}
        must = _must_run(reference, before, keys, set(result.targets))
        ran = record.with_status("ran")
        assert max(Counter(keys[name] for name in ran).values(), default=1) == 1
        assert {keys[name] for name in ran} <= {keys[name] for name in must}
        # What need not run after all found its bytes among those that another node made.
        assert all(store.actions.find(keys[name]) is not None for name in must)
        assert all(store.actions.get(keys[name]) is not None for name in result.targets)
        # What the plan was sure of came true; a bare node may be read by one of which it could not tell.
        sure = {node.address for node in planned if node.status == "cached" and not node.bare}
        assert sure.isdisjoint(ran)
        if all(node.status == "cached" for node in planned):
            assert ran == []
        again, record = run(graph, store, *targets)
        assert again.ok
        assert record.with_status("ran") == []
        if dice.random() < 0.6:
            random_graph.edit()
