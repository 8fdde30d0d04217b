"""A chain that no recursion survives: built, found built, edited at its leaf."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import pytest

from dextera_build.engine import dry
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.key import Writer
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult
from dextera_build.engine.schedule import Scheduler
from dextera_build.store.store import Store
from tests.engine.tiny import call, graph, inline, leaf, out, run


def chain(length: int, file: Path) -> Graph:
    return graph(call("n0", x=leaf(file)), *(call(f"n{place}", x=out(f"n{place - 1}")) for place in range(1, length)))


def statuses(result: RunResult) -> set[str]:
    return {node.status for node in result.nodes.values()}


def test_no_key_document_is_held_while_nodes_wait(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    spelled: list[str] = []
    document = Writer.document
    monkeypatch.setattr(Writer, "document", lambda *words: spelled.append(words[1].name) or document(*words))
    names = [f"n{number}" for number in range(20)]
    scheduler = Scheduler(graph(*map(call, names)), store, inline(), RunPolicy())
    scheduler.run([Address((name,)) for name in names])
    nodes = scheduler.wiring.nodes.values()
    assert {node.status for node in nodes} == {"ran"}
    # Once to look it up, and once to publish what ran.
    assert Counter(spelled) == Counter(dict.fromkeys(names, 2))
    assert not any(node.document for node in nodes)


@pytest.mark.medium
@pytest.mark.parametrize("length", [1_200, pytest.param(100_000, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])])
def test_a_chain_may_be_long(store: Store, tmp_path: Path, length: int) -> None:
    assert length > sys.getrecursionlimit()
    file = tmp_path / "leaf"
    file.write_text("one")
    plan = chain(length, file)
    first, _ = run(plan, store)
    assert first.ok
    assert len(first.nodes) == length
    assert statuses(first) == {"ran"}
    assert statuses(run(plan, store)[0]) == {"cached"}

    file.write_text("two")
    assert {node.status for node in dry.plan(plan, plan.targets["default"], store)} == {"stale", "unknown"}
    edited, _ = run(plan, store)
    assert statuses(edited) == {"ran"}
    last = f"n{length - 1}"
    assert edited.nodes[last].output != first.nodes[last].output
