"""Which worker takes a task when some hold models, and which must go."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.workers import warm
from dextera_build.workers.capacity import Capacity, Gpu, Needs
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Ended, Task

RUNNER = f"{__name__}:run_task"
_held: list[bytes] = []


def run_task(task: Mapping[str, Any], emit: Callable[[str, Any], None]) -> dict[str, Any]:
    """Keep as many bytes as asked, like a model, and tell the process."""
    if task["weights"]:
        _held[:] = [os.urandom(task["options"]["bytes"])]
    return {"output": str(os.getpid()), "line": "", "previews": [], "metrics": {}}


def task(weights: str = "", memory_gb: float = 0.1, bytes_: int = 0, **needs: Any) -> Task:
    devices = needs.pop("devices", ())
    held = (weights,) if weights else ()
    options = {"bytes": bytes_}
    return Task(0, "r", "b", options, {}, "/", "/", "cpu", Needs(1, memory_gb, **needs), devices, weights=held)


@dataclass
class Held:
    """A worker as the policy sees it."""

    holds: tuple[str, ...] = ()
    held_gb: float = 0.0
    held_gpu_gb: float = 0.0
    idle_since: float = 0.0
    devices: tuple[str, ...] = ()
    task: Task | None = None


def test_a_task_goes_to_the_worker_with_its_model_then_to_an_empty_one_then_to_the_oldest() -> None:
    a, b, empty = Held(("a",), idle_since=2), Held(("b",), idle_since=1), Held()
    assert warm.choose([empty, b, a], task("a")) is a
    assert warm.choose([b, empty, a], task("c")) is empty
    assert warm.choose([a, b], task("c")) is b
    assert warm.choose([a, b], task()) is None
    assert warm.choose([a, empty], task()) is empty


def test_of_two_empty_workers_the_first_takes_every_task_so_that_one_of_them_imports_its_modules() -> None:
    first, second = Held(idle_since=2), Held(idle_since=1)
    assert warm.choose([first, second], task()) is first


def test_idle_models_leave_oldest_first_only_as_far_as_a_task_needs() -> None:
    old, new = Held(("a",), 3.0, idle_since=1), Held(("b",), 3.0, idle_since=2)
    busy = Held(("c",), task=task("c", 2.0))
    workers = [new, busy, old]
    for memory_gb, gone in ((1.0, [old]), (0.0, []), (5.0, [old, new]), (100.0, [old, new])):
        assert warm.surplus(workers, task(memory_gb=memory_gb), None, Capacity(4, 8.0)) == gone
    assert warm.surplus(workers, task("a", 5.0), old, Capacity(4, 8.0)) == [new]


def test_models_on_a_gpu_leave_when_another_call_needs_its_memory() -> None:
    capacity = Capacity(4, 100.0, (Gpu("0", 10.0), Gpu("1", 10.0)))
    here, there = Held(("a",), 1.0, 6.0, 1, ("0",)), Held(("b",), 1.0, 6.0, 2, ("1",))
    assert warm.surplus([here, there], task("c", gpu_gb=5.0, devices=("0",)), None, capacity) == [here]
    assert warm.surplus([here, there], task("c", gpu_gb=4.0, devices=("0",)), None, capacity) == []
    unknown = Capacity(4, 100.0, (Gpu("0", 0.0),))
    assert warm.surplus([here], task("c", gpu_gb=1.0, devices=("0",)), None, unknown) == [here]


@given(st.lists(st.tuples(st.floats(0, 9), st.booleans()), max_size=6), st.floats(0, 20))
def test_what_stays_fits_beside_the_task_and_nothing_leaves_in_vain(
    held: list[tuple[float, bool]], need: float
) -> None:
    workers = [
        Held((f"m{n}",), gb, idle_since=n, task=task(memory_gb=gb) if busy else None)
        for n, (gb, busy) in enumerate(held)
    ]
    gone = warm.surplus(workers, task(memory_gb=need), None, Capacity(9, 10.0))
    stay = [worker for worker in workers if worker not in gone]
    used = need + sum(worker.task.needs.memory_gb if worker.task else worker.held_gb for worker in stay)
    assert used <= 10.0 + 1e-9 or not any(worker.task is None for worker in stay)
    assert all(worker.task is None for worker in gone)
    if gone:
        assert used + gone[-1].held_gb > 10.0 - 1e-9


def answers(pool: LocalExecutor, *tasks: Task) -> list[str]:
    """Processes that ran tasks, one after another."""
    found = []
    for each in tasks:
        pool.submit(each)
        reports: list[Any] = []
        while not any(isinstance(report, Ended) for report in reports):
            reports += pool.poll(5.0)
        (end,) = (report for report in reports if isinstance(report, Ended))
        assert end.reply is not None, end.error
        found.append(end.reply["output"])
    return found


@pytest.mark.medium
def test_the_pool_keeps_models_apart_from_other_work_and_comes_back_to_them() -> None:
    with LocalExecutor(RUNNER, Capacity(1, 4.0)) as pool:
        plain, first, again, between, other, last = answers(
            pool, task(), task("a"), task("a"), task(), task("b"), task("a")
        )
    assert first == again == plain  # the only worker was empty
    assert between != first
    assert other == between  # an empty one, rather than that with another model
    assert last == first


@pytest.mark.slow
def test_an_idle_model_gives_way_to_a_task_that_needs_its_memory() -> None:
    with LocalExecutor(RUNNER, Capacity(1, 0.5)) as pool:
        first, other = answers(pool, task("a", bytes_=300 << 20), task(memory_gb=0.4))
        assert first != other
        assert [str(pid) for pid in pool.pids()] == [other]


@pytest.mark.medium
def test_an_idle_model_leaves_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm, "IDLE_S", 0.2)
    with LocalExecutor(RUNNER, Capacity(1, 4.0)) as pool:
        (first,) = answers(pool, task("a"))
        assert [str(pid) for pid in pool.pids()] == [first]
        time.sleep(0.3)
        pool.poll(0.0)
        assert pool.pids() == []
        (again,) = answers(pool, task("a"))
        assert again != first
