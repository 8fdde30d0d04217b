"""Short nodes that stand behind others at a worker: none is lost, none runs twice, none waits for a long one."""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dextera_build.engine import dispatch, known, seats
from dextera_build.engine.events import Event, NodeFinished, NodeStarted
from dextera_build.engine.execute import RunResult, build
from dextera_build.engine.executors.local import LocalExecutor
from dextera_build.engine.executors.nursery import Nursery
from dextera_build.engine.executors.process import Process
from dextera_build.engine.graph import Graph, RuleFacts
from dextera_build.engine.seats import LONG_S, Pace, Seat, nap_s
from dextera_build.engine.tasks import PACKET, Task
from dextera_build.engine.units import Node
from dextera_build.store.store import Store
from tests.engine.tiny import FACTS, RUNNER, Record, call, facts, graph, inline, leaf, out


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a machine that is busy everything takes long; who stands behind whom shall not hang on that."""
    monkeypatch.setattr(seats, "_MOST_S", 1e3)


class Pool(LocalExecutor):
    """Counts who stood behind another, and who was taken back."""

    def __init__(self, jobs: int, folder: Path) -> None:
        super().__init__(RUNNER, jobs, environment={"TINY_TRACE": str(folder / "trace")})
        self.folder = folder
        self.behind = 0
        self.back: list[int] = []

    def submit_behind(self, task: Task, ticket: int) -> None:
        self.behind += 1
        super().submit_behind(task, ticket)

    def take_back(self, ticket: int) -> list[int]:
        back = super().take_back(ticket)
        self.back += back
        (self.folder / "taken back").touch()
        return back


def row(count: int = 60, **special: tuple[str, Any]) -> Graph:
    """Nodes that do not depend on one another; `n20=("kill", 0)` has one do something else."""
    names = [f"n{place}" for place in range(count)]
    return graph(*(call(name, *special.get(name, ("blob", 0))) for name in names), default=tuple(names))


def run(plan: Graph, tmp_path: Path, jobs: int = 1, **flags: Any) -> tuple[RunResult, Record, Pool, Counter[str]]:
    """Build with a pool; also how often each node ran. A file tells when 59 nodes have finished."""
    record = Record()

    def listen(event: Event) -> None:
        record(event)
        if len(record.with_status("ran")) == 59:
            (tmp_path / "59").touch()

    with Pool(jobs, tmp_path) as pool:
        store = Store(tmp_path / "store")
        result = build(plan, plan.targets["default"], store=store, executor=pool, listen=listen, **flags)
    return result, record, pool, Counter((tmp_path / "trace").read_text().split())


def assert_told_once_and_in_order(events: list[Event]) -> None:
    """Who finished had begun, and nobody begins twice."""
    begun: set[str] = set()
    for event in events:
        if isinstance(event, NodeStarted):
            assert event.node not in begun
            begun.add(event.node)
        elif isinstance(event, NodeFinished) and event.status in ("ran", "failed"):
            assert event.node in begun


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("jobs", [1, 3])
def test_all_run_once_with_the_results_that_they_have_alone(tmp_path: Path, jobs: int) -> None:
    result, record, pool, ran = run(row(), tmp_path, jobs)
    alone = build(row(), row().targets["default"], store=Store(tmp_path / "b"), executor=inline(), listen=Record())
    assert result.ok
    assert {name: node.output for name, node in result.nodes.items()} == {
        name: node.output for name, node in alone.nodes.items()
    }
    assert set(ran.values()) == {1}
    assert len(ran) == 60
    assert pool.behind > 20
    assert_told_once_and_in_order(record.events)


@pytest.mark.usefixtures("unhurried")
def test_a_worker_that_dies_takes_nobody_with_it_who_stands_behind(tmp_path: Path) -> None:
    plan = row(n20=("kill", 0), n21=("kill", 0), n40=("segfault", 0))
    result, record, pool, ran = run(plan, tmp_path, keep_going=True)
    assert sorted(record.with_status("failed")) == ["n20", "n21", "n40"]
    assert len(record.with_status("ran")) == 57
    assert set(ran.values()) == {1}
    error = result.nodes["n20"].error
    assert error is not None
    assert (error.code, error.facts["log"]) == ("DXB-B301", "about to die")
    assert pool.behind > 20
    assert_told_once_and_in_order(record.events)


@pytest.mark.usefixtures("unhurried")
def test_nobody_waits_for_a_long_one(tmp_path: Path) -> None:
    result, record, _, ran = run(row(n20=("await", str(tmp_path / "59"))), tmp_path, jobs=2)
    assert result.ok
    assert record.with_status("ran")[-1] == "n20"
    assert set(ran.values()) == {1}
    assert_told_once_and_in_order(record.events)


@pytest.mark.usefixtures("unhurried")
def test_who_has_not_begun_when_a_node_fails_does_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "LONG_S", 1e3)
    plan = row(n20=("fail", 0), n21=("await", str(tmp_path / "taken back")))
    _, record, pool, ran = run(plan, tmp_path)
    assert record.with_status("failed") == ["n20"]
    begun = {f"n{place}" for place in range(22 if "n21" in ran else 21)}
    assert set(ran) == begun
    assert len(record.with_status("cancelled")) == 60 - len(begun)
    assert pool.behind > 5
    again, record, _, _ = run(row(), tmp_path)
    assert again.ok
    assert len(record.with_status("ran")) == 60 - 20


@pytest.mark.usefixtures("unhurried")
def test_what_a_node_printed_stays_its_own(tmp_path: Path) -> None:
    plan = row(n20=("crash", "luck"), n21=("print", "hello \x00 wörld"))
    result, *_ = run(plan, tmp_path, keep_going=True)
    store = Store(tmp_path / "store")
    logs = {name: store.blobs.get(node.log) for name, node in result.nodes.items() if node.log}
    assert set(logs) == {"n20", "n21"}
    assert b"ValueError: bad luck" in logs["n20"]
    assert logs["n21"] == "hello \x00 wörld\nand to stderr\n".encode()


@pytest.mark.usefixtures("unhurried")
def test_large_tasks_come_through_among_others(tmp_path: Path) -> None:
    large = {f"n{place}": ("blob", "x" * (PACKET + place)) for place in (0, 20, 21, 30)}
    result, _, pool, ran = run(row(**large), tmp_path)
    assert result.ok
    assert set(ran.values()) == {1}
    assert pool.behind > 20


def task(ticket: int, do: str, value: object = 0) -> Task:
    """A task whose store goes with the tests' scratch folder."""
    options = {"do": do, "value": value, "name": f"t{ticket}"}
    return Task(ticket, "tiny.rule", None, options, {}, os.environ["TINY_STORE"], "", "")


@pytest.fixture
def process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Process]:
    monkeypatch.setenv("TINY_STORE", str(tmp_path / "store"))
    nursery = Nursery()
    nursery.load(RUNNER, {"TINY_TRACE": str(tmp_path / "trace")}, [])
    worker = Process(nursery)
    try:
        yield worker
    finally:
        worker.end(0.0)
        nursery.end()


def heard(process: Process, count: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    deadline = time.monotonic() + 60
    while len(found) < count and time.monotonic() < deadline:
        lines, _ = process.hear()
        found += lines
        time.sleep(0.01)
    return found


def test_what_was_not_begun_is_taken_back_and_what_was_is_not(process: Process, tmp_path: Path) -> None:
    process.give(task(0, "fail"))
    assert len(heard(process, 1)) == 1
    process.advance()
    for ticket in (1, 2, 3):
        process.give(task(ticket, "await", str(tmp_path / "go")))
    wait_for(tmp_path / "trace", "t1")
    assert [one.ticket for one in process.take_back()] == [2, 3]
    (tmp_path / "go").touch()
    process.give(task(4, "fail", 4))
    said = heard(process, 2)
    assert [one.get("error", {}).get("facts") for one in said] == [None, {"value": "4"}]
    assert process.take_back() == [one for one in process.tasks if one.ticket > 4]


def test_a_worker_that_goes_on_while_tasks_are_taken_back_has_what_it_has(process: Process, tmp_path: Path) -> None:
    process.give(task(0, "await", str(tmp_path / "first")))
    for ticket, do in ((1, "fail"), (2, "await"), (3, "fail")):
        process.give(task(ticket, do, str(tmp_path / "third")))
    wait_for(tmp_path / "trace", "t0")
    taken: list[bytes] = []
    real = process._taking

    class Slow:
        """Lets the worker take the third task after the second was taken back."""

        def recv(self, size: int, flags: int) -> bytes:
            if len(taken) == 1:
                (tmp_path / "first").touch()
                wait_for(tmp_path / "trace", "t2")
            taken.append(real.recv(size, flags))
            return taken[-1]

        def close(self) -> None:
            real.close()

    process._taking = Slow()  # type: ignore[assignment]
    assert [one.ticket for one in process.take_back()] == [1, 3]
    assert [one.ticket for one in process.tasks] == [0, 2]
    (tmp_path / "third").touch()
    assert ["error" in one for one in heard(process, 2)] == [False, False]


def wait_for(trace: Path, name: str) -> None:
    """Until a worker has begun this task."""
    deadline = time.monotonic() + 60
    while not trace.exists() or name not in trace.read_text().split():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_before_a_worker_has_begun_all_is_taken_back(process: Process) -> None:
    for ticket in range(3):
        process.give(task(ticket, "fail", "x" * (PACKET if ticket == 1 else 1)))
    assert [one.ticket for one in process.take_back()] == [0, 1, 2]
    process.give(task(3, "fail", "y" * PACKET))
    (said,) = heard(process, 1)
    assert said["error"]["facts"] == {"value": "y" * PACKET}


def node(address: str = "n", rule: RuleFacts = FACTS) -> Node:
    made = Node(address=address, path=(address,), labels=(), graph=graph(call(address)))
    made.rule = rule
    return made


def test_a_pace_is_known_after_some_runs_and_follows() -> None:
    pace = Pace()
    assert pace.expected_s(node()) > 1e5
    pace.note(FACTS, 60.0)  # a worker loads the rule with its first call
    for _ in range(10):
        pace.note(FACTS, 0.001)
    assert pace.expected_s(node()) == pytest.approx(0.001)
    assert pace.expected_s(node(rule=facts(backend="other"))) > 1e5
    for _ in range(100):
        pace.note(FACTS, 1.0)
    assert pace.expected_s(node()) == pytest.approx(1.0, rel=0.02)


def test_until_then_the_least_that_a_node_of_the_rule_took_the_last_time_counts() -> None:
    pace = Pace({"slow": 3.0, "n": 2.0, "other": 5.0}.get)
    assert pace.expected_s(node("slow")) == 3.0
    assert pace.expected_s(node("n")) == 2.0
    assert pace.expected_s(node("slow")) == pace.expected_s(node("new")) == 2.0
    assert pace.expected_s(node("other", facts(backend="other"))) == 5.0
    for _ in range(10):
        pace.note(FACTS, 0.5)
    assert pace.expected_s(node("slow")) == pytest.approx(0.5)


class Counting(Pool):
    """Counts the workers."""

    made = 0

    def _start(self, devices: tuple[str, ...]) -> Process:
        self.made += 1
        return super()._start(devices)


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize("is_brief", [True, False])
def test_what_the_worker_does_before_another_is_there_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_brief: bool
) -> None:
    monkeypatch.setattr(dispatch, "LONG_S", 1e3)
    file = tmp_path / "leaf"
    file.write_text("one")
    names = tuple(f"n{place}" for place in range(1, 7))
    plan = graph(call("n0", x=leaf(file)), *(call(name, x=out("n0")) for name in names), default=names)
    first, *_ = run(plan, tmp_path, jobs=3)
    assert first.wiring is not None
    assert known.write(tmp_path / "snapshot", plan, first.wiring, "0001")
    file.write_text("two")
    found = known.read(tmp_path / "snapshot")
    assert found.spread([str(file)])
    if not is_brief:
        monkeypatch.setattr(known.Known, "took", lambda self, address: 1e9)
    with Counting(3, tmp_path) as pool:
        targets = found.graph.targets["default"]
        store = Store(tmp_path / "store")
        result = build(found.graph, targets, store=store, executor=pool, listen=Record(), known=found)
    assert result.ok
    assert {result.nodes[name].status for name in names} == {"ran"}
    assert pool.made == (1 if is_brief else 3)


def seat(*expected_s: float) -> Seat:
    nodes = [Node(address=f"n{n}", path=(f"n{n}",), labels=(), graph=graph(call("n"))) for n in range(len(expected_s))]
    return Seat(deque(zip(nodes, expected_s, strict=True)), sum(expected_s))


def test_a_seat_is_full_by_number_and_by_time() -> None:
    assert not seat(1e6).fits(0.0)
    assert seat(0.001).fits(0.001)
    assert not seat(0.001).fits(0.01)
    assert not seat(*[0.0001] * 24).fits(0.0001)
    assert seat(0.001, 0.001).room == (22, pytest.approx(0.008))
    late = seat(0.001)
    late.is_late = True
    assert late.room == (0, 0.0)
    assert not late.fits(0.001)
    late.add(late.first, 0.001)
    late.advance()
    assert late.fits(0.001)
    assert late.left_s == pytest.approx(0.001)


def test_naps_are_shorter_than_what_there_is_to_do() -> None:
    assert nap_s([]) == nap_s([seat(1.0)]) == nap_s([seat(0.001, 0.0001)]) == 0.0
    assert nap_s([seat(*[0.0005] * 4), seat(*[0.0001] * 9)]) == pytest.approx(0.0004)
    assert nap_s([seat(*[0.001] * 5)]) < LONG_S
