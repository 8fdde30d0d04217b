"""The Ray executor without Ray: shapes, places, and a cluster whose workers are objects of this process."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dextera_build.engine.capacity import Capacity, Gpu, Needs
from dextera_build.engine.executors import ray_cluster, ray_worker, shapes, staging
from dextera_build.engine.executors.placement import Idle, Places, Shape
from dextera_build.engine.executors.ray import RayExecutor
from dextera_build.engine.executors.ray_cluster import Hand, Heard
from dextera_build.engine.executors.ray_worker import RayWorker, Setup
from dextera_build.engine.tasks import Task
from dextera_build.errors import MachineError
from dextera_build.store.cas import MissingBlob
from dextera_build.store.remotes.connect import open_remote
from dextera_build.store.remotes.spec import Spec
from dextera_build.store.store import Store
from tests.engine.tiny import RUNNER, Record, call, facts, graph, out, run
from tests.engine.tiny import build as build_graph

GIB = 2**30
NODES = {
    "big": {"CPU": 8.0, "memory": 16.0 * GIB, "GPU": 2.0, "node:10.0.0.1": 1.0, "accelerator_type:H200": 1.0},
    "small": {"CPU": 2.0, "memory": 4.0 * GIB, "licence:solver": 1.0},
}


def shape(**amounts: float) -> Shape:
    return Shape(tuple(sorted(amounts.items())))


def test_the_capacity_is_that_of_all_nodes() -> None:
    found = shapes.capacity(NODES, {"gpu_memory": 80.0, "licence:arm": 3.0})
    gpus = (Gpu("big:0", 80.0), Gpu("big:1", 80.0))
    assert found == Capacity(10, 20.0, gpus, {"licence:solver": 1.0, "licence:arm": 3.0}, is_cluster=True)
    assert shapes.capacity(NODES, {"cpu": 3.0}).cpus == 3


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
    assert dict(shapes.shape(needs, NODES.values(), 80.0).amounts) == expected


def test_a_part_of_a_gpu_of_unknown_size_is_the_whole_gpu() -> None:
    assert dict(shapes.shape(Needs(gpu_gb=20.0), NODES.values()).amounts)["GPU"] == 1.0


def test_options_of_an_actor() -> None:
    reserved = shape(CPU=2.0, GPU=0.5, memory=3.0 * GIB, **{"licence:solver": 1.0})
    resources = {"licence:solver": 1.0}
    assert shapes.options(reserved) == {"num_cpus": 2.0, "num_gpus": 0.5, "memory": 3 * GIB, "resources": resources}
    assert shapes.options(shape(CPU=1.0)) == {"num_cpus": 1.0, "num_gpus": 0.0, "memory": None, "resources": None}


def test_what_no_single_node_has_is_said() -> None:
    with pytest.raises(MachineError, match=r"1 of `licence:solver`, 2 of `GPU` on one node") as caught:
        shapes.shape(Needs(gpus=2, named=(("licence:solver", 1.0),)), NODES.values())
    assert caught.value.code == "DXB-E352"
    assert caught.value.facts == {"most `GPU` of a node": "2", "most `licence:solver` of a node": "1"}
    assert caught.value.hint is not None
    assert "--num-gpus=2 --resources='{\"licence:solver\": 1.0}'`" in caught.value.hint


def test_a_cluster_without_a_machine_is_said() -> None:
    with pytest.raises(MachineError, match="no machine of the cluster is left") as caught:
        shapes.shape(Needs(), [])
    assert caught.value.code == "DXB-E354"


def test_a_place_near_the_inputs_is_chosen_before_an_empty_one() -> None:
    places = Places(NODES)
    assert places.choose(shape(CPU=1.0), {}) == "big"
    assert places.choose(shape(CPU=1.0), {"small": 1}) == "small"
    places.take("small", shape(CPU=2.0))
    assert places.choose(shape(CPU=1.0), {"small": 1}) == "big"
    places.give_back("small", shape(CPU=2.0))
    assert places.choose(shape(CPU=1.0), {"small": 1}) == "small"


def test_thirds_of_a_gpu_fill_it_and_no_more() -> None:
    places, third = Places({"n": {"GPU": 1.0}}), shape(GPU=1 / 3)
    for _ in range(3):
        node = places.choose(third, {})
        assert node == "n"
        places.take(node, third)
    assert places.choose(third, {}) is None


def test_room_is_made_where_fewest_must_go() -> None:
    places = Places({"a": {"CPU": 2.0}, "b": {"CPU": 2.0}})
    one, two = shape(CPU=1.0), shape(CPU=2.0)
    idle = [Idle("a1", "a", one), Idle("a2", "a", one), Idle("b1", "b", two)]
    for each in idle:
        places.take(each.node, each.shape)
    assert places.choose(two, {}) is None
    assert places.make_room(two, idle) == ("b", ["b1"])
    assert places.make_room(two, idle[:2]) == ("a", ["a1", "a2"])
    assert places.make_room(two, idle[:1]) is None
    assert places.make_room(one, idle) == ("a", ["a1"])


def test_nodes_come_and_go_and_what_is_reserved_stays() -> None:
    places, one = Places({"a": {"CPU": 2.0}}), shape(CPU=1.0)
    places.take("a", one)
    places.update({"a": {"CPU": 1.0}, "b": {"CPU": 1.0}})
    assert places.choose(one, {}) == "b"
    places.update({"b": {"CPU": 1.0}})
    places.give_back("a", one)
    assert list(places.nodes) == ["b"]
    places.update({"a": {"CPU": 1.0}})
    assert places.choose(one, {}) == "a"


class _Answering:
    """A hand whose worker is an object of this process, with the node's store where its environment says."""

    def __init__(self, worker: RayWorker, trouble: list[Exception]) -> None:
        self._worker, self._trouble = worker, trouble
        # One thread for all calls, as in an actor: the process that runs them ends with the thread that started it.
        self._thread = ThreadPoolExecutor(1)
        self.killed = False

    def run(self, task: Task, fresh: bool, heard: Heard) -> None:
        if self._trouble:
            heard(self._trouble.pop())
        else:
            self._thread.submit(lambda: heard(self._worker.run(task, fresh)))

    def more(self, heard: Heard) -> None:
        self._thread.submit(lambda: heard(self._worker.more()))

    def stop(self) -> None:
        self._worker.stop()

    def kill(self) -> None:
        self.killed = True
        self._thread.shutdown(wait=False)


class _Here:
    """A cluster of one node, in this process."""

    address = "127.0.0.1"

    def __init__(self) -> None:
        self.trouble: list[Exception] = []
        self.hired: list[tuple[Shape, _Answering]] = []

    def nodes(self) -> Mapping[str, Mapping[str, float]]:
        return {"here": {"CPU": 2.0, "memory": 8.0 * GIB}}

    def hire(self, setup: Setup, shape: Shape, node: str) -> Hand:
        hand = _Answering(RayWorker(setup), self.trouble)
        self.hired.append((shape, hand))
        return hand

    def close(self) -> None: ...


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> _Here:
    monkeypatch.setenv(ray_worker.STORE, str(tmp_path / "node"))
    return _Here()


@pytest.fixture
def pool(here: _Here, store: Store) -> Iterator[RayExecutor]:
    with RayExecutor(here, store, Setup(RUNNER, "")) as executor:
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
    result = build_graph(plan, targets, store=store, executor=pool, listen=Record(), keep_going=True)
    errors = {name: node.error for name, node in result.nodes.items()}
    assert [errors[name] and errors[name].code for name in "abc"] == ["DXB-B202", "DXB-B301", "DXB-B302"]
    assert errors["a"] is not None
    assert errors["a"].facts == {"value": "3"}


def test_a_lost_worker_costs_a_try_and_no_result(pool: RayExecutor, here: _Here, store: Store) -> None:
    here.trouble += [ConnectionError("the node went away")] * 2
    record = Record()
    result = build_graph(PLAN, PLAN.targets["default"], store=store, executor=pool, listen=record)
    assert result.ok
    said = [event.text for event in record.events if event.kind == "node_log"]
    assert said[:2] == ["its worker was lost (the node went away), it begins anew"] * 2
    assert [hand.killed for _, hand in here.hired[:2]] == [True, True]


def test_a_call_that_always_loses_its_worker_fails(pool: RayExecutor, here: _Here, store: Store) -> None:
    here.trouble += [ConnectionError("the node went away")] * 3
    result = build_graph(PLAN, PLAN.targets["default"], store=store, executor=pool, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert (error.code, error.message) == ("DXB-E354", "its worker was lost 3 times")
    assert error.facts == {"ray says": "the node went away"}


def test_a_process_that_is_killed_each_time_fails_in_the_end(pool: RayExecutor, store: Store) -> None:
    plan, record = graph(call("a", "kill")), Record()
    result = build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=record)
    error = result.nodes["a"].error
    assert error is not None
    assert error.code == "DXB-B301"
    said = [event.text for event in record.events if event.kind == "node_log"]
    assert said == ["its process was killed, it begins anew"] * 2


def test_a_worker_that_needs_more_takes_the_room_of_one_that_waits(
    pool: RayExecutor, here: _Here, store: Store
) -> None:
    wide = facts(path="tiny.wide", cpus=2)
    plan = graph(call("a"), call("b", rule=wide, x=out("a")))
    assert build_graph(plan, plan.targets["default"], store=store, executor=pool, listen=Record()).ok
    assert [dict(shape.amounts)["CPU"] for shape, _ in here.hired] == [1.0, 2.0]
    assert here.hired[0][1].killed


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


def test_a_node_with_other_code_is_refused(here: _Here, store: Store) -> None:
    setup = Setup(RUNNER, "", stand={"dextera-build": "abc"}, compare="tests.engine.test_ray:other_code")
    with RayExecutor(here, store, setup) as pool:
        result = build_graph(PLAN, PLAN.targets["default"], store=store, executor=pool, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert error.code == "DXB-E353"
    assert error.message == "a node of the cluster has another `dextera-build` than the driver"
    assert error.facts["`dextera-build`"] == "driver abc, node xyz"


def other_code(stand: Mapping[str, str], project: str) -> dict[str, tuple[str, str]]:
    return {name: (version, "xyz") for name, version in stand.items()}


def test_only_who_has_the_password_is_served(pool: RayExecutor, store: Store) -> None:
    httpx = pytest.importorskip("httpx")
    digest = store.blobs.put(b"secret")
    url = re.sub("//.*@", "//", pool._setup.driver) + f"/cas/{digest}"
    assert httpx.get(url).status_code == 401
    assert httpx.get(url, auth=("dxb", "guess")).status_code == 401
    assert httpx.get(pool._setup.driver + f"/cas/{digest}").content == b"secret"


def test_a_driver_that_cannot_be_reached_is_said(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(staging, "_RESTS_S", (0.0,))
    away = staging.Staging(store, open_remote(Spec("driver", "http://127.0.0.1:1", "rw")))
    with pytest.raises(MachineError, match="a worker cannot reach the store of the driver: no connection") as caught:
        away.pull(["0" * 64])
    assert (caught.value.code, caught.value.facts) == ("DXB-E355", {"driver": "http://127.0.0.1:1"})


def test_what_the_driver_lacks_is_named(pool: RayExecutor, tmp_path: Path) -> None:
    lacking = staging.Staging(Store(tmp_path / "other"), open_remote(Spec("driver", pool._setup.driver, "rw")))
    with pytest.raises(MissingBlob) as caught:
        lacking.pull(["1" * 64])
    assert caught.value.digest == "1" * 64


@pytest.mark.parametrize("address", ["127.0.0.1:1", "127.0.0.1:port", "127.0.0.1:99999"])
def test_where_no_cluster_answers_it_is_said(address: str) -> None:
    with pytest.raises(MachineError, match=f"no Ray cluster answers at `{address}`") as caught:
        ray_cluster._reach(address)
    assert caught.value.code == "DXB-E351"
