"""The pool of worker processes: reuse, admission, logs, and how it ends."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dextera_build.engine.graph import Call, Graph
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult, build
from dextera_build.errors import MachineError
from dextera_build.runs.events import Event, NodeFinished, NodeLog, NodeProgress, NodeStarted
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity, Gpu
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Task
from tests.engine.tiny import RUNNER, Record, call, every, facts, graph, group, item, out
from tests.engine.tiny import run_task as run_task


@pytest.fixture
def pool() -> Iterator[LocalExecutor]:
    with LocalExecutor(RUNNER, Capacity(2, 4.0)) as executor:
        yield executor


def run(plan: Graph, store: Store, pool: LocalExecutor, **flags: Any) -> tuple[RunResult, Record]:
    record = Record()
    result = build(plan, plan.targets["default"], store=store, executor=pool, listen=record, policy=RunPolicy(**flags))
    return result, record


if os.path.exists(os.environ.get("TINY_SLOW", "")):
    time.sleep(60.0)  # a runner that takes long to load
if os.environ.get("TINY_DIES_READY"):
    _write = sys.modules["__main__"].Worker._write

    def _write_and_die(worker: Any, answer: dict[str, object]) -> None:
        _write(worker, answer)
        os.kill(os.getpid(), 9)

    sys.modules["__main__"].Worker._write = _write_and_die


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_workers_are_kept_and_no_more_than_needed(store: Store, pool: LocalExecutor) -> None:
    wide = [call(f"n{n}") for n in range(20)]
    result, _ = run(graph(*wide, default=tuple(each.name for each in wide)), store, pool)
    assert result.ok
    first = set(pool.pids())
    assert len(first) <= 2
    run(graph(call("later")), store, pool)
    assert set(pool.pids()) == first


def test_a_chain_needs_one_worker(store: Store, pool: LocalExecutor) -> None:
    links: list[Call] = [call("n0"), *(call(f"n{n}", x=out(f"n{n - 1}")) for n in range(1, 9))]
    run(graph(*links), store, pool)
    assert len(pool.pids()) == 1


def test_groups_build_in_the_pool(store: Store, pool: LocalExecutor) -> None:
    plan = graph(
        call("seg", "items", {"mug": "m", "box": "b"}),
        group("body", out("seg"), call("mesh", seen=item("body"))),
        call("scene", all=every("body.mesh")),
    )
    result, _ = run(plan, store, pool)
    assert result.ok
    assert len(result.nodes) == 4


@pytest.mark.medium
def test_a_node_that_keeps_two_cores_busy_runs_alone_among_two_jobs(store: Store, pool: LocalExecutor) -> None:
    wide = facts(path="tiny.wide", cpus=2)
    names = ("w0", "n0", "w1", "n1", "n2")
    plan = graph(
        *(call(name, "sleep", 0.15, **({"rule": wide} if name[0] == "w" else {})) for name in names), default=names
    )
    result, record = run(plan, store, pool)
    assert result.ok
    running: set[str] = set()
    beside: dict[str, set[str]] = {name: set() for name in names}
    for event in record.events:
        if isinstance(event, NodeStarted):
            for other in running:
                beside[other].add(event.node)
                beside[event.node].add(other)
            running.add(event.node)
        elif isinstance(event, NodeFinished):
            running.discard(event.node)
    assert beside["w0"] == beside["w1"] == set()
    assert beside["n0"] | beside["n1"] | beside["n2"] <= {"n0", "n1", "n2"}


def test_what_a_node_prints_is_its_log(store: Store, pool: LocalExecutor) -> None:
    plan = graph(call("loud", "print", "hello"), call("quiet", x=out("loud")))
    result, _ = run(plan, store, pool)
    log = result.nodes["loud"].log
    assert log is not None
    assert store.blobs.get(log).splitlines() == [b"hello", b"and to stderr"]
    assert result.nodes["quiet"].log is None
    key = result.nodes["loud"].key
    assert key is not None
    kept = store.actions.get(key)
    assert kept is not None
    assert kept.log == log


def test_a_node_may_have_large_options(store: Store, pool: LocalExecutor) -> None:
    text = "x" * (1 << 22)
    plan = graph(call("a", "const", text), call("b", "const", "small"), default=("a", "b"))
    result, _ = run(plan, store, pool)
    assert result.ok
    assert text.encode() in store.blobs.get(result.nodes["a"].output or "")


def test_progress_and_log_lines_arrive(store: Store, pool: LocalExecutor) -> None:
    result, record = run(graph(call("a", "tell", "hello")), store, pool)
    assert [event.what for event in record.of(NodeProgress)] == ["halves"]
    assert [event.text for event in record.of(NodeLog)] == ["hello"]
    log = result.nodes["a"].log
    assert log is not None
    assert store.blobs.get(log) == b"hello\n"


def test_errors_cross_the_border_whole(store: Store, pool: LocalExecutor) -> None:
    result, _ = run(graph(call("a", "fail", 3)), store, pool)
    error = result.nodes["a"].error
    assert error is not None
    assert (error.message, error.code, error.facts, error.hint) == (
        "no such luck",
        "DXB-B202",
        {"value": "3"},
        "try again",
    )
    crash, _ = run(graph(call("b", "crash", "luck")), store, pool)
    error = crash.nodes["b"].error
    assert error is not None
    assert error.message == "ValueError: bad luck"
    log = crash.nodes["b"].log
    assert log is not None
    assert b"Traceback" in store.blobs.get(log)


@pytest.mark.parametrize(
    ("how", "value", "reason"),
    [("kill", 0, "signal 9"), ("segfault", 0, "signal 11"), ("exit", 3, "exit code 0")],
)
def test_a_worker_that_dies_fails_its_node_only(
    store: Store, pool: LocalExecutor, how: str, value: int, reason: str
) -> None:
    plan = graph(call("bad", how, value), call("good"), call("end", a=out("bad"), b=out("good")))
    result, record = run(plan, store, pool, keep_going=True)
    error = result.nodes["bad"].error
    assert error is not None
    assert error.code == "DXB-B301"
    assert error.message == f"worker died ({reason})"
    assert result.nodes["good"].status == "ran"
    assert result.nodes["end"].status == "waits"
    if how == "kill":
        assert error.facts["signal"] == "9 (SIGKILL)"
        assert error.facts["printed"] == "about to die"
    if how == "segfault":
        assert "Segmentation fault" in error.facts["printed"]
    again, _ = run(graph(call("good2")), store, pool)
    assert again.ok
    assert [event.node for event in record.of(NodeFinished) if event.status == "failed"] == ["bad"]


def test_a_worker_that_was_started_early_takes_the_first_task(store: Store, pool: LocalExecutor) -> None:
    pool.warm()
    first = pool.pids()
    assert run(graph(call("a")), store, pool)[0].ok
    assert pool.pids() == first
    assert run(graph(call("b")), store, pool)[0].ok
    assert pool.pids() == first


@pytest.mark.medium
def test_a_task_goes_to_the_worker_that_is_free_first(store: Store, tmp_path: Path) -> None:
    slow = tmp_path / "slow"
    with LocalExecutor("tests.workers.test_pool:run_task", Capacity(2, 4.0), {"TINY_SLOW": str(slow)}) as pool:
        run(graph(call("first")), store, pool)
        slow.touch()  # a second worker would load for a minute
        began = time.monotonic()
        naps = [call(f"n{number}", "sleep", 0.3) for number in range(3)]
        result, _ = run(graph(*naps, default=tuple(nap.name for nap in naps)), store, pool)
        assert time.monotonic() - began < 40.0
        assert len(pool.pids()) == 2
    assert result.ok


def test_a_worker_that_was_given_nothing_is_not_waited_for() -> None:
    with LocalExecutor("tests.workers.test_pool:run", Capacity(), {"TINY_SLOW": "/"}) as pool:
        pool.warm()
        (started,) = pool.pids()
        time.sleep(0.5)
        began = time.monotonic()
    assert time.monotonic() - began < 30.0  # it would load for a minute
    assert not alive(started)


def test_a_worker_that_dies_idle_is_replaced(store: Store, pool: LocalExecutor) -> None:
    run(graph(call("a")), store, pool)
    (first,) = pool.pids()
    os.kill(first, 9)
    time.sleep(0.1)
    result, _ = run(graph(call("b")), store, pool)
    assert result.ok
    assert pool.pids() != [first]


def test_a_worker_that_dies_between_its_loading_and_its_first_task_fails_the_task() -> None:
    with LocalExecutor("tests.workers.test_pool:run_task", Capacity(1, 4.0), {"TINY_DIES_READY": "1"}) as pool:
        pool.submit(Task(0, "tiny.rule", None, {"do": "const", "value": 1, "name": "t"}, {}, "/tmp", "", ""))
        os.waitid(os.P_PID, pool.pids()[0], os.WEXITED | os.WNOWAIT)  # both its message and its end can be read now
        (end,) = pool.poll(0.0)
    assert isinstance(end, Ended)
    assert end.error is not None
    assert end.error.message == "worker died (signal 9)"


@pytest.mark.parametrize("junk", [b"{}", b"\xff\0", b"[" * 100_000, b'{"said": 1}'], ids=range(4))
def test_a_worker_that_sends_what_is_no_message_fails_its_node_only(
    store: Store, pool: LocalExecutor, junk: bytes
) -> None:
    plan = graph(call("bad", "junk", junk.decode("latin-1")), call("good"), default=("bad", "good"))
    result, _ = run(plan, store, pool, keep_going=True)
    error = result.nodes["bad"].error
    assert error is not None
    assert (error.code, error.message) == ("DXB-B301", "worker died (sent an invalid message)")
    assert result.nodes["good"].status == "ran"


def test_the_long_text_of_an_exception_is_cut(store: Store, pool: LocalExecutor) -> None:
    result, _ = run(graph(call("a", "crash", "x" * 5_000_000)), store, pool)
    error = result.nodes["a"].error
    assert error is not None
    assert len(error.message) < 2000


def test_a_runner_that_cannot_be_imported_says_so(store: Store) -> None:
    with LocalExecutor("tests.engine.nowhere:run", Capacity(1, 4.0)) as pool:
        result, _ = run(graph(call("a")), store, pool)
    error = result.nodes["a"].error
    assert error is not None
    assert error.code == "DXB-E201"
    assert error.message == "a worker cannot start: ModuleNotFoundError: No module named 'tests.engine.nowhere'"


def test_a_worker_that_cannot_be_started_says_so(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, **more: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("subprocess.Popen", refuse)
    with (
        LocalExecutor(RUNNER, Capacity(1, 4.0)) as pool,
        pytest.raises(MachineError, match="cannot be started") as caught,
    ):
        run(graph(call("a")), store, pool)
    assert (caught.value.code, caught.value.hint) == ("DXB-E202", "build with `--jobs 1`")


def test_close_leaves_no_process(store: Store) -> None:
    with LocalExecutor(RUNNER, Capacity(2, 4.0)) as pool:
        run(graph(call("a"), call("b"), default=("a", "b")), store, pool)
        pids = pool.pids()
        assert pids
    assert not any(alive(pid) for pid in pids)


def test_stop_ends_what_runs_at_once() -> None:
    pool = LocalExecutor(RUNNER, Capacity(1, 4.0))
    sleeping = Task(0, "tiny.rule", None, {"do": "sleep", "value": 60, "name": "t"}, {}, "/tmp", "", "")
    pool.submit(sleeping)
    time.sleep(0.5)
    began = time.monotonic()
    pids = pool.pids()
    pool.stop()
    assert time.monotonic() - began < 30.0  # the task would sleep on for a minute
    assert not any(alive(pid) for pid in pids)


@pytest.mark.medium
def test_a_worker_that_holds_a_device_goes_when_another_needs_it(store: Store) -> None:
    capacity = Capacity(4, 8.0, (Gpu("a", 8.0), Gpu("b", 8.0)))
    plan = graph(
        call("one", rule=facts(path="tiny.one", gpus=1)),
        call("again", rule=facts(path="tiny.one", gpus=1), x=out("one")),
        call("none", x=out("again")),
        call("both", rule=facts(path="tiny.both", gpus=2), x=out("none")),
    )
    with LocalExecutor(RUNNER, capacity) as pool:
        seen: dict[str, list[int]] = {}

        def listen(event: Event) -> None:
            if isinstance(event, NodeFinished):
                seen[event.node] = sorted(pool.pids())

        result = build(plan, plan.targets["default"], store=store, executor=pool, listen=listen)
    assert result.ok
    assert seen["again"] == seen["one"]  # the same devices, the same worker
    assert len(seen["none"]) == 2
    assert not set(seen["one"]) & set(seen["both"])
