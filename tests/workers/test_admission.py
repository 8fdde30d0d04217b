"""Which task starts next: never over capacity, nobody starves, all finish."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.workers.admission import Admission, estimate, lacks
from dextera_build.workers.capacity import Capacity, Gpu, Needs

LICENCE = (("licence:solver", 1.0),)


@dataclass(frozen=True)
class Job:
    """A task with what it needs, how long it runs, and when it comes."""

    name: int
    needs: Needs
    lasts: int
    comes: int = 0


def simulate(capacity: Capacity, jobs: Iterable[Job]) -> Iterator[tuple[int, Job, tuple[str, ...], list[Job]]]:
    """(when, job, its devices, all that run then) for every start, in order of time."""
    line: Admission[Job] = Admission(capacity)
    coming = sorted(jobs, key=lambda job: (job.comes, job.name))
    ends: list[tuple[int, int, Job]] = []
    running: list[Job] = []
    now = 0
    while True:
        while coming and coming[0].comes <= now:
            job = coming.pop(0)
            line.wait(job, job.needs)
        while (started := line.next()) is not None:
            running.append(started)
            heapq.heappush(ends, (now + started.lasts, started.name, started))
            yield now, started, line.devices(started), list(running)
        if not ends and not coming:
            return
        now = min([*(end for end, _, _ in ends[:1]), *(job.comes for job in coming[:1])])
        while ends and ends[0][0] <= now:
            _, _, over = heapq.heappop(ends)
            running.remove(over)
            line.end(over)


capacities = st.builds(
    Capacity,
    cpus=st.integers(1, 6),
    memory_gb=st.floats(0.5, 16),
    gpus=st.lists(st.builds(Gpu, id=st.uuids().map(str), memory_gb=st.sampled_from([0.0, 8.0, 24.0])), max_size=3).map(
        tuple
    ),
    named=st.just({"licence:solver": 2.0}),
)


@st.composite
def works(draw: st.DrawFn) -> tuple[Capacity, list[Job]]:
    capacity = draw(capacities)
    needs = st.builds(
        Needs,
        cpus=st.integers(0, 8),
        memory_gb=st.floats(0, 20),
        gpus=st.integers(0, len(capacity.gpus)),
        gpu_gb=st.sampled_from([0.0, 3.0, 12.0, 80.0]) if capacity.gpus else st.just(0.0),
        named=st.sampled_from([(), LICENCE, (("licence:solver", 2.0),)]),
    )
    kinds = draw(st.lists(needs, min_size=1, max_size=4))
    drawn = st.tuples(st.sampled_from(kinds), st.integers(1, 9), st.integers(0, 30))
    return capacity, [Job(name, *rest) for name, rest in enumerate(draw(st.lists(drawn, min_size=1, max_size=40)))]


@pytest.mark.medium
@settings(max_examples=300, deadline=None)
@given(works())
def test_never_over_capacity_and_all_finish(work: tuple[Capacity, list[Job]]) -> None:
    capacity, jobs = work
    held: dict[int, tuple[str, ...]] = {}
    for _, job, devices, running in simulate(capacity, jobs):
        held[job.name] = devices
        if len(running) > 1:
            assert sum(max(one.needs.cpus, 1) for one in running) <= capacity.cpus
            assert sum(one.needs.memory_gb for one in running) <= capacity.memory_gb + 0.001 * len(running)
        assert sum(dict(one.needs.named).get("licence:solver", 0) for one in running) <= 2
        for gpu in capacity.gpus:
            on = [one for one in running if gpu.id in held[one.name]]
            if len(on) > 1:
                assert not any(one.needs.gpus for one in on)
                assert sum(one.needs.gpu_gb for one in on) <= gpu.memory_gb
        wanted = max(job.needs.gpus, 1 if job.needs.gpu_gb else 0)
        assert len(set(devices)) == len(devices) == wanted
    assert sorted(held) == [job.name for job in jobs]


@pytest.mark.parametrize("seed", range(20))
def test_a_large_task_does_not_starve_behind_endless_small_ones(seed: int) -> None:
    chance = random.Random(seed)
    cpus, longest = chance.randint(2, 6), chance.randint(2, 5)
    small = [Job(n, Needs(1), chance.randint(1, longest), comes=n // (2 * cpus)) for n in range(600)]
    big = Job(1000, Needs(cpus), 1, comes=1)
    (began,) = [when for when, job, _, _ in simulate(Capacity(cpus, 64), [*small, big]) if job is big]
    # Those that came before it, eight that pass it, and what runs then.
    before = sum(job.lasts for job in small if job.comes <= 1)
    assert began <= 1 + before / cpus + (8 + 2) * longest


def test_small_tasks_go_on_while_a_large_one_waits() -> None:
    line: Admission[str] = Admission(Capacity(2, 8, (Gpu("0"),)))
    line.wait("first", Needs(1, gpus=1))
    line.wait("second", Needs(1, gpus=1))
    line.wait("small", Needs(1))
    assert [line.next(), line.next(), line.next()] == ["first", "small", None]


def test_what_fits_beside_a_reservation_may_still_start() -> None:
    line: Admission[str] = Admission(Capacity(4, 8, (Gpu("0"),)), passes=0)
    line.wait("first", Needs(1, gpus=1))
    line.wait("second", Needs(2, gpus=1))
    for name in ("a", "b", "c"):
        line.wait(name, Needs(1))
    # The second will need the device and two cores, so two of the four are free for others whatever comes.
    assert [line.next() for _ in range(4)] == ["first", "a", "b", None]
    line.end("first")
    assert [line.next(), line.next()] == ["second", None]


def test_a_task_that_wants_more_than_there_is_runs_alone() -> None:
    line: Admission[str] = Admission(Capacity(4, 8))
    line.wait("huge", Needs(1, memory_gb=900))
    line.wait("wide", Needs(64))
    line.wait("small", Needs(1))
    assert [line.next(), line.next()] == ["huge", None]
    line.end("huge")
    # No longer elder than all: the wide one goes, again alone.
    assert [line.next(), line.next()] == ["wide", None]


def test_devices_are_shared_by_memory_and_taken_whole_by_count() -> None:
    line: Admission[str] = Admission(Capacity(8, 64, (Gpu("a", 24), Gpu("b", 8))))
    for name in ("x", "y"):
        line.wait(name, Needs(1, gpu_gb=4))
    line.wait("whole", Needs(1, gpus=1))
    line.wait("again", Needs(1, gpus=1))
    # The smallest rest that is large enough, so that the large device stays whole.
    assert [line.next() for _ in range(4)] == ["x", "y", "whole", None]
    assert [line.devices(name) for name in ("x", "y", "whole")] == [("b",), ("b",), ("a",)]
    line.end("x")
    assert line.next() is None
    line.end("y")
    assert line.next() == "again"


@pytest.mark.parametrize(
    ("needs", "lacking"),
    [
        (Needs(gpus=2), {"gpu": (2, 1)}),
        (Needs(gpu_gb=4), {}),
        (Needs(named=LICENCE), {"licence:solver": (1.0, 0)}),
        (Needs(cpus=99, memory_gb=1e4), {}),
    ],
)
def test_only_devices_and_named_resources_can_lack(needs: Needs, lacking: dict[str, tuple[float, float]]) -> None:
    assert needs.lacks(Capacity(1, 1, (Gpu("0", 1),))) == lacking


def test_who_lacks_what_is_said_with_what_helps() -> None:
    error = lacks({"licence:solver": (2, 1)})
    assert error.message == "it needs 2 of `licence:solver`, which is more than there is"
    assert error.facts == {"`licence:solver` here": "1"}
    assert "`--resources licence:solver=2`" in (error.hint or "")


@given(st.floats(0.001, 2000))
def test_the_estimate_lies_a_little_above_what_was_measured(peak: float) -> None:
    memory = estimate(Needs(2, 4.0, 1), peak).memory_gb
    assert peak * 1.25 <= memory <= peak * 1.6 + 0.2
    # Coarse, so that tasks of one rule stand in few lines.
    assert len({estimate(Needs(), peak * (1 + n / 1000)).memory_gb for n in range(100)}) <= 3


def test_without_a_measurement_the_declaration_holds() -> None:
    declared = Needs(2, 4.0, 1, 8.0, LICENCE)
    assert estimate(declared, None) == declared
    assert estimate(declared, 1.0) == Needs(2, 1.5, 1, 8.0, LICENCE)
    assert math.isclose(estimate(declared, 10.0).memory_gb, 14)
