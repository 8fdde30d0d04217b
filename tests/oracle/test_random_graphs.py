"""Random graphs, edited at random and built again: exactly those nodes run that the reference runs."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from dextera_build.engine.dry import plan
from dextera_build.engine.graph import Address, Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult, build
from dextera_build.runs.events import NodeStarted
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from tests.engine.tiny import RUNNER, Record, inline
from tests.oracle.graphs import RandomGraph
from tests.oracle.reference import Reference

_STEPS = 5


def _build(graph: Graph, targets: list[Address], store: Store, keep_going: bool = False) -> tuple[RunResult, Record]:
    record = Record()
    return build(
        graph, targets, store=store, executor=inline(), listen=record, policy=RunPolicy(keep_going=keep_going)
    ), record


@pytest.mark.parametrize("seed", range(60))
def test_exactly_the_stale_nodes_run(seed: int, tmp_path: Path) -> None:
    random_graph, store = RandomGraph(seed, tmp_path, reads=True), Store(tmp_path / "store")
    cache: dict[str, str] = {}
    for _ in range(_STEPS):
        graph, targets = random_graph.graph(), random_graph.targets()
        expected = Reference(graph, cache)
        planned = {node.address: node.status for node in plan(graph, targets, store)}
        expected.build(targets)
        result, record = _build(graph, targets, store)

        assert result.ok
        assert {name: node.output for name, node in result.nodes.items()} == expected.outputs
        ran = Counter(expected.keys[name] for name in record.with_status("ran"))
        assert ran == Counter(expected.ran)
        assert len(record.with_status("ran")) + len(record.with_status("cached")) == len(result.nodes)
        for name, node in result.nodes.items():  # what the plan was sure of came true
            if planned.get(name) == "cached":
                assert node.status == "cached"
        again, _ = _build(graph, targets, store)
        assert {node.status for node in again.nodes.values()} <= {"cached"}
        random_graph.edit()


@pytest.mark.parametrize("seed", range(30))
def test_with_failures_everything_independent_is_built(seed: int, tmp_path: Path) -> None:
    random_graph, store = RandomGraph(seed, tmp_path, reads=True), Store(tmp_path / "store")
    random_graph.break_one()
    random_graph.break_one()
    graph, targets = random_graph.graph(), random_graph.targets()
    expected = Reference(graph, {})
    expected.build(targets)
    result, record = _build(graph, targets, store, keep_going=True)

    status = {name: node.status for name, node in result.nodes.items()}
    assert {name for name, s in status.items() if s == "failed"} == expected.failed
    assert {name for name, s in status.items() if s in ("ran", "cached")} == {
        name for name, output in expected.outputs.items() if output is not None
    }
    assert Counter(expected.keys[name] for name in record.with_status("ran")) == Counter(expected.ran)
    assert result.ok == (not expected.failed)
    for node in result.nodes.values():
        assert (node.status == "waits") == bool(node.blocked_by)
        assert set(node.blocked_by) <= expected.failed


@pytest.mark.parametrize("seed", range(80))
def test_runs_go_on_without_what_failed(seed: int, tmp_path: Path) -> None:
    random_graph, store = RandomGraph(seed, tmp_path, reads=True), Store(tmp_path / "store")
    for _ in range(3):
        random_graph.break_one()
    random_graph.forgive()
    graph, targets = random_graph.graph(), random_graph.targets()
    expected = Reference(graph, {})
    expected.build(targets)
    result, _ = _build(graph, targets, store, keep_going=True)

    status = {name: node.status for name, node in result.nodes.items()}
    assert {name for name, s in status.items() if s == "failed"} == expected.failed
    assert {name: node.output for name, node in result.nodes.items()} == expected.outputs
    assert result.ok == expected.ok(targets)
    again, _ = _build(graph, targets, store)
    if "stop" not in map(expected.effect, expected.failed):
        assert {name: node.output for name, node in again.nodes.items()} == expected.outputs
        assert again.ok == result.ok


@pytest.mark.parametrize("seed", range(30))
def test_the_first_failure_stops_what_has_not_begun(seed: int, tmp_path: Path) -> None:
    random_graph, store = RandomGraph(seed, tmp_path, reads=True), Store(tmp_path / "store")
    random_graph.break_one()
    graph, targets = random_graph.graph(), random_graph.targets()
    expected = Reference(graph, {})
    expected.build(targets)
    result, record = _build(graph, targets, store)

    # Copies of one key fail together, and one of them ran.
    failed = {node.key for node in result.nodes.values() if node.status == "failed"}
    assert len(failed) == min(1, len(expected.failed))
    for name, node in result.nodes.items():
        if node.status in ("ran", "cached"):
            assert node.output == expected.outputs[name]
        elif node.status == "waits":
            assert expected.outputs[name] is None
    started = {event.node for event in record.of(NodeStarted)}
    assert started >= set(record.with_status("ran"))
    assert len(record.of(NodeStarted)) == len(record.with_status("ran")) + len(failed)


@pytest.mark.slow
def test_a_pool_runs_exactly_the_stale_nodes_too(tmp_path: Path) -> None:
    with LocalExecutor(RUNNER, Capacity(3, 4.0)) as pool:
        for seed in range(100, 112):
            folder = tmp_path / str(seed)
            folder.mkdir()
            random_graph, store = RandomGraph(seed, folder, reads=True), Store(folder / "store")
            cache: dict[str, str] = {}
            for _ in range(3):
                graph, targets = random_graph.graph(), random_graph.targets()
                expected, record = Reference(graph, cache), Record()
                expected.build(targets)
                result = build(graph, targets, store=store, executor=pool, listen=record)
                assert result.ok
                assert {name: node.output for name, node in result.nodes.items()} == expected.outputs
                assert Counter(expected.keys[name] for name in record.with_status("ran")) == Counter(expected.ran)
                random_graph.edit()
