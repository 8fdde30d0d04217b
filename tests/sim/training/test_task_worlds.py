"""Worlds that are judged, valued and observed together fare bit for bit as each one alone, by any number of threads."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import Reset, TaskBundle
from dextera_build.policy.terms import Sensor
from dextera_build.sim.training.gym import TaskEnv
from dextera_build.sim.training.task_worlds import TaskWorlds
from dextera_build.sim.training.threads import Threads
from tests import task_bundles

WIDE = Reset(position_m=0.03, yaw_rad=0.5, robot_rad=0.01, dynamics=1.0, joints=1.0)
GOALS = Reset(joint_rad=0.1, goal_rad=0.2)
PLAN = ((0.1, 0.05, 18), (0.0, 0.05, 8), (0.0, 0.012, 6), (0.15, 0.012, 200))
"""Height of the palm and opening of the fingers [m], and control periods, of a lift."""
LIFT = [np.array([0.3, 0.1, height, fingers, fingers]) for height, fingers, periods in PLAN for _ in range(periods)]


@pytest.mark.medium
@pytest.mark.parametrize(
    ("bundle", "shared"),
    [
        (task_bundles.lift(reset=Reset(position_m=0.004, dynamics=1.0)), True),
        (task_bundles.close(reset=GOALS), False),
    ],
    ids=["one judge", "a judge for each"],
)
def test_worlds_fare_as_each_would_alone(bundle: TaskBundle, shared: bool) -> None:
    """One world stands still for a while, one gets what no robot can do, one begins again."""
    options = {"privileged": True, "sensors": {"objects": Sensor(sigma=0.002, delay_s=0.05)}}
    together = TaskWorlds(bundle, 3, threads=2, **options)
    alone = [TaskEnv(bundle, **options) for _ in range(3)]
    together.begin([0, 1, 2], lambda number: together.tasks[number].begin(number))
    assert together._verdicts.own == (set() if shared else {0, 1, 2})
    seen = together.observe()
    single = [each.reset(seed=number)[0] for number, each in enumerate(alone)]
    successes = 0
    for period in range(60):
        for name, values in seen.items():
            assert values.tobytes() == np.stack([row[name] for row in single]).tobytes(), (name, period)
        wanted = [LIFT[period], None if period < 5 else LIFT[period - 5], LIFT[period]]
        if period == 40:
            wanted[2] = np.full(5, np.nan)
        outcomes = together.advance(wanted)
        steps = together.steps(outcomes)
        if period == 41:
            together.begin([2], lambda number: together.tasks[number].begin(77))
        seen = together.observe(steps.faults)
        for number, each in enumerate(alone):
            if wanted[number] is None:
                # Its sensors measure all the same.
                single[number] = each._observe()
                continue
            single[number], reward, ended, late, info = each.step(wanted[number].astype(np.float64))
            assert (steps.rewards[number], steps.ended[number], steps.late[number]) == (reward, ended, late)
            assert (outcomes[number].success, outcomes[number].reason) == (info["success"], info["reason"])
            successes += info["success"]
            if period == 41 and number == 2:
                single[number], _ = each.reset(seed=77)
    assert bool(successes) is shared
    together.close()


def test_a_world_with_a_goal_of_its_own_has_its_own_judge() -> None:
    bundle = task_bundles.close()
    together, alone = TaskWorlds(bundle, 3, threads=1), [TaskEnv(bundle) for _ in range(3)]
    start = together.environments[0].start
    goal = bundle.task.goal.model_copy(update={"joints": {"case_lid_hinge": 1.0}})
    other = start.model_copy(update={"variation": start.variation.model_copy(update={"goal": goal})})
    for starts, own in (((start, other, start), {1}), ((start, start, other), {2})):
        chosen = [{"start": each} for each in starts]
        together.begin([0, 1, 2], lambda number, chosen=chosen: together.tasks[number].begin(None, chosen[number]))
        assert together._verdicts.own == own
        for each, option in zip(alone, chosen, strict=True):
            each.reset(options=option)
        for period in range(3):
            target = np.array([0.1 * period, -0.1, 0.1, 0.05, 0.05])
            rewards = together.steps(together.advance([target] * 3)).rewards
            assert rewards.tolist() == [each.step(target)[1] for each in alone]
        assert len(set(rewards.tolist())) == 2
        seen = together.observe()["deployable/goal"]
        assert [row.tolist() for row in seen] == [each.environment.goal.tolist() for each in alone]
    together.close()


def test_a_world_does_what_it_does_by_any_number_of_threads() -> None:
    bundle, found = task_bundles.lift(reset=WIDE), []
    for threads in (1, 2, 5):
        worlds = TaskWorlds(bundle, 5, threads=threads, privileged=True)
        worlds.begin(range(5), lambda number, worlds=worlds: worlds.tasks[number].begin(number))
        for period in range(30):
            outcomes = worlds.advance([LIFT[period]] * 5)
        rewards = worlds.steps(outcomes).rewards
        found.append((rewards.tobytes(), {name: each.tobytes() for name, each in worlds.observe().items()}))
        worlds.close()
    assert found[0] == found[1] == found[2]


def test_threads_share_the_work_and_hand_on_what_fails() -> None:
    threads = Threads(3, 10)
    met, barrier = set(), threading.Barrier(3, timeout=10)

    def work(number: int) -> int:
        if number < 3:
            met.add(threading.get_ident())
            barrier.wait()
        return number * number

    assert threads.each(work, 10) == [number * number for number in range(10)]
    assert len(met) == 3
    with pytest.raises(ZeroDivisionError):
        threads.each(lambda number: 1 // (number - 7), 10)
    threads.close()
    assert Threads(8, 2).count == 2
