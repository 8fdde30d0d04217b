"""The Ray executor without Ray: shapes, and a cluster whose one node is this process."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from dextera_build.engine.policy import RunPolicy
from dextera_build.errors import MachineError
from dextera_build.remotes.spec import Spec, open_remote
from dextera_build.runs.events import NodeRetried
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store
from dextera_build.workers import ray_cluster, ray_worker, staging
from dextera_build.workers.capacity import Capacity, Gpu, Needs
from dextera_build.workers.protocol import Report, Task
from dextera_build.workers.ray import RayExecutor
from dextera_build.workers.ray_cluster import RayCluster
from dextera_build.workers.ray_worker import Setup
from dextera_build.workers.retries import Retries
from tests.engine.tiny import RUNNER, Record, call, facts, graph, out, run
from tests.engine.tiny import build as build_graph

GIB = 2**30
NODES = [
    {"CPU": 8.0, "memory": 16.0 * GIB, "GPU": 2.0, "node:10.0.0.1": 1.0, "accelerator_type:H200": 1.0},
    {"CPU": 2.0, "memory": 4.0 * GIB, "licence:solver": 1.0},
]


def test_the_capacity_is_that_of_all_nodes() -> None:
    found = ray_cluster.capacity(NODES, {"gpu_memory": 80.0, "licence:arm": 3.0})
    gpus = (Gpu("0", 80.0), Gpu("1", 80.0))
    assert found == Capacity(10, 20.0, gpus, {"licence:solver": 1.0, "licence:arm": 3.0})
    assert ray_cluster.capacity(NODES, {"cpu": 3.0}).cpus == 3


@pytest.mark.parametrize(
    ("needs", "expected"),
    [
        (Needs(), {"CPU": 1.0}),
        (Needs(4, 2.0), {"CPU": 4.0, "memory": 2.0 * GIB}),
        (Needs(100, 1000.0), {"CPU": 8.0, "memory": 16.0 * GIB}),
        (Needs(4, named=(("licence:solver", 1.0),)), {"CPU": 2.0, "licence:solver": 1.0}),
        (Needs(gpus=2), {"CPU": 1.0, "GPU": 2.0}),
        (Needs(gpu_gb=20.0), {"CPU": 1.0, "GPU": 0.25}),
        (Needs(named=(("licence:arm", 1.0),)), {"CPU": 1.0}),
    ],
)
def test_needs_become_what_ray_reserves(needs: Needs, expected: dict[str, float]) -> None:
    assert dict(ray_cluster.shape(needs, NODES, 80.0)) == expected


def test_a_part_of_a_gpu_of_unknown_size_is_the_whole_gpu() -> None:
    assert dict(ray_cluster.shape(Needs(gpu_gb=20.0), NODES))["GPU"] == 1.0


def test_options_of_a_task(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[dict[str, object]] = []
    task = SimpleNamespace(remote=lambda *words: None, options=lambda **words: asked.append(words) or task)
    ray = SimpleNamespace(init=lambda **words: None, remote=lambda **words: lambda function: task)
    monkeypatch.setitem(sys.modules, "ray", ray)
    monkeypatch.setattr(ray_cluster, "_reach", lambda address: None)
    cluster = RayCluster("127.0.0.1:1", tmp_path)
    for reserved in ({"CPU": 2.0, "GPU": 0.5, "memory": 3.0 * GIB, "licence:solver": 1.0}, {"CPU": 1.0}):
        cluster.begin(None, None, reserved)
    resources = {"licence:solver": 1.0}
    assert asked == [
        {"num_cpus": 2.0, "num_gpus": 0.5, "memory": 3 * GIB, "resources": resources},
        {"num_cpus": 1.0, "num_gpus": 0.0, "memory": None, "resources": None},
    ]


def test_what_no_single_node_has_is_said() -> None:
    with pytest.raises(MachineError, match=r"1 of `licence:solver`, 2 of `GPU` on one node") as caught:
        ray_cluster.shape(Needs(gpus=2, named=(("licence:solver", 1.0),)), NODES)
    assert caught.value.code == "DXB-E352"
    assert caught.value.facts == {"most `GPU` of a node": "2", "most `licence:solver` of a node": "1"}


def test_a_cluster_without_a_machine_is_said() -> None:
    with pytest.raises(MachineError, match="no machine of the cluster is left") as caught:
        ray_cluster.shape(Needs(), [])
    assert caught.value.code == "DXB-E354"


class _Here:
    """A cluster of one node, in this process; calls run one after another, a word at a time."""

    def __init__(self) -> None:
        self.trouble: list[Exception] = []
        self.there: list[Mapping[str, float]] = [{"CPU": 2.0, "memory": 8.0 * GIB}]

    def nodes(self) -> list[Mapping[str, float]]:
        return list(self.there)

    def begin(self, setup: Setup, task: Task, reserved: Mapping[str, float]) -> Iterator[Report]:
        return ray_worker.carry_out(setup, task)

    def hear(self, calls: Iterable[Iterator[Report]], timeout_s: float) -> Iterator[tuple[Any, Report | Exception]]:
        for each in list(calls) if self.there else []:
            # As between machines, where reports travel as pickles.
            yield each, self.trouble.pop() if self.trouble else pickle.loads(pickle.dumps(next(each)))

    def cancel(self, call: Any) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[_Here]:
    monkeypatch.setenv(ray_worker.STORE, str(tmp_path / "node"))
    monkeypatch.setattr("dextera_build.workers.ray._LOOK_S", 0.1)
    yield _Here()
    for place in ray_worker._here:
        place._pool.stop()
    ray_worker._here.clear()


@pytest.fixture
def shared(tmp_path: Path) -> Spec:
    return Spec("shared", str(tmp_path / "shared"), "rw")


@pytest.fixture
def pool(here: _Here, store: Store, shared: Spec) -> Iterator[RayExecutor]:
    with RayExecutor(here, store, Setup(RUNNER, shared)) as executor:
        yield executor


PLAN = graph(call("a", "blob"), call("b", "print", "hello", x=out("a")), call("c", "tell", "half", x=out("b")))


def test_results_are_those_of_one_machine_and_the_stores_are_two(
    pool: RayExecutor, store: Store, tmp_path: Path
) -> None:
    record = Record()
    result = build_graph(PLAN, PLAN.targets["default"], store=store, executor=pool, listen=record)
    alone, _ = run(PLAN, Store(tmp_path / "alone"))
    assert {name: (node.key, node.output) for name, node in result.nodes.items()} == {
        name: (node.key, node.output) for name, node in alone.nodes.items()
    }
    log = result.nodes["b"].log
    assert log is not None
    assert store.blobs.get(log).splitlines() == [b"hello", b"and to stderr"]
    assert {event.kind for event in record.events} >= {"node_progress", "node_log"}
    assert any(Store(tmp_path / "node").blobs.all())


def test_errors_and_deaths_are_told_as_on_one_machine(pool: RayExecutor, store: Store) -> None:
    plan = graph(call("a", "fail", 3), call("b", "segfault"), call("c", "crash", 1), default=("a", "b", "c"))
    targets = plan.targets["default"]
    result = build_graph(plan, targets, store=store, executor=pool, listen=Record(), policy=RunPolicy(keep_going=True))
    errors = {name: node.error for name, node in result.nodes.items()}
    assert [errors[name] and errors[name].code for name in "abc"] == ["DXB-B202", "DXB-B301", "DXB-B302"]
    assert errors["a"] is not None
    assert errors["a"].facts == {"value": "3"}


QUICK = facts(retries=Retries(wait_s=0.01))


def test_a_lost_worker_costs_a_try_and_no_result(pool: RayExecutor, here: _Here, store: Store) -> None:
    here.trouble += [ConnectionError("the node went away")] * 2
    plan, record = graph(call("a", "blob", rule=QUICK), call("b", x=out("a"))), Record()
    result = build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=record)
    assert result.ok
    assert [event.error["facts"] for event in record.of(NodeRetried)] == [{"ray says": "the node went away"}] * 2


def test_a_call_that_always_loses_its_worker_fails(pool: RayExecutor, here: _Here, store: Store) -> None:
    here.trouble += [ConnectionError("the node went away")] * 3
    plan = graph(call("a", rule=QUICK))
    result = build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert (error.code, error.message, result.nodes["a"].tries) == ("DXB-E354", "its worker was lost", 3)
    assert error.facts == {"ray says": "the node went away"}


def test_a_call_does_not_wait_for_machines_that_are_gone(pool: RayExecutor, here: _Here, store: Store) -> None:
    here.there.clear()
    plan = graph(call("a", rule=QUICK))
    result = build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert (error.code, error.message) == ("DXB-E354", "no machine of the cluster is left")


@pytest.mark.medium
def test_bytes_that_the_node_damaged_are_fetched_again(pool: RayExecutor, store: Store, tmp_path: Path) -> None:
    plan = graph(call("a", "blob"))
    assert build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=Record()).ok
    node = Store(tmp_path / "node")
    for digest, size in node.blobs.all():
        path = node.blobs.path(digest)
        path.chmod(0o644)
        path.write_bytes(b"x" * size)
    result = build_graph(PLAN, PLAN.targets["default"], store=store, executor=pool, listen=Record())
    assert result.ok


def test_a_rule_that_reads_the_project_by_itself_stays_on_one_machine(here: _Here, store: Store, shared: Spec) -> None:
    with RayExecutor(here, store, Setup(RUNNER, shared), discovering={"tiny.rule"}) as pool:
        plan = graph(call("a", rule=facts(path="tiny.rule")))
        result = build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert error.code == "DXB-E370"


def test_a_shared_remote_that_does_not_answer_is_said(store: Store) -> None:
    away = staging.Staging(store, open_remote(Spec("shared", "http://127.0.0.1:1", "rw")))
    with pytest.raises(MachineError, match="the remote that the cluster shares does not work: no connection") as caught:
        away.bring(["0" * 64])
    assert (caught.value.code, caught.value.facts) == ("DXB-E355", {"remote": "http://127.0.0.1:1"})


def test_what_the_shared_remote_lacks_is_named(store: Store, shared: Spec) -> None:
    with pytest.raises(MissingBlob) as caught:
        staging.Staging(store, open_remote(shared)).bring(["1" * 64])
    assert caught.value.digest == "1" * 64


@pytest.mark.parametrize("address", ["127.0.0.1:1", "127.0.0.1:port", "127.0.0.1:99999"])
def test_where_no_cluster_answers_it_is_said(address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "ray", ModuleType("ray"))
    with pytest.raises(MachineError, match=f"no Ray cluster answers at `{address}`") as caught:
        RayCluster(address, tmp_path)
    assert caught.value.code == "DXB-E351"
