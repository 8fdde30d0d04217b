"""What counts as success, on states that are made by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from dextera_build.sim.primitives.lift import primitive as lift
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.state import TaskState
from dextera_build.sim.primitives.success import Judge, holds
from tests import factories
from tests.sim.primitives.traces import grasped

PERIOD_S = 0.05
LIFT = TaskSpec(name="Lift", object="box", goal=LiftGoal(height_m=0.1), hold_s=0.5)
CLOSE = TaskSpec(name="Close", object="case", goal=ArticulateGoal(joints={"lid": 0.0}, tolerance=0.1), hold_s=0.5)


def box(time_s: float = 0.0, z: float = 0.15, **grasp: Any) -> TaskState:
    """The box at height `z`, held well but for what is given."""
    held = grasped(**{"fingers": 2, "opposing": True, "supported": False, **grasp})
    return TaskState(np.array([time_s]), factories.pose(z=z)[None], grasps={"arm": held})


def case(
    time_s: float = 0.0, lid: float = 0.0, speed: float = 0.0, pose: np.ndarray | None = None, **others: float
) -> TaskState:
    """The case with its lid at `lid`."""
    positions = {"lid": lid, **others}
    return TaskState(
        time_s=np.array([time_s]),
        world_from_object=(np.eye(4) if pose is None else pose)[None],
        joints={name: np.array([position]) for name, position in positions.items()},
        ranges=dict.fromkeys(positions, np.array([[0.0, 2.0]])),
        speeds=dict.fromkeys(positions, np.array([speed])),
    )


def verdicts(task: TaskSpec, start: TaskState, state: Callable[[float], TaskState], periods: int) -> list[bool]:
    judge = Judge(task, start)
    return [bool(judge.update(state(PERIOD_S * step))[0]) for step in range(1, periods + 1)]


TABLE = box(z=0.02, fingers=0, opposing=False, supported=True)


def test_a_box_held_up_for_long_enough_is_lifted():
    assert verdicts(LIFT, TABLE, lambda time: box(time), 11) == [False] * 10 + [True]


@pytest.mark.parametrize(
    "fault",
    [
        {"z": 0.119},
        {"fingers": 0, "opposing": False},
        {"fingers": 1, "opposing": False},
        {"fingers": 3, "opposing": False},
        {"supported": True},
        {"slip_m_s": 0.06},
        {"z": float("nan")},
        {"slip_m_s": float("nan")},
    ],
    ids=["too low", "flying", "on one finger", "on a fork", "pinned against something", "slipping", "NaN", "NaN slip"],
)
def test_what_is_not_a_lift_never_counts(fault):
    assert not any(verdicts(LIFT, TABLE, lambda time: box(time, **fault), 40))


def test_a_box_that_is_dropped_and_caught_starts_anew():
    def state(time: float) -> TaskState:
        return box(time, slip_m_s=0.5 if abs(time - 0.5) < 0.01 else 0.0)

    found = verdicts(LIFT, TABLE, state, 22)
    assert found.index(True) == 20  # 0.55 s + 0.5 s


@pytest.mark.parametrize("fault", [{}, {"lid": 0.09}, {"speed": 0.2}])
def test_a_lid_that_rests_at_its_command_is_closed(fault):
    assert any(verdicts(CLOSE, case(lid=1.5), lambda time: case(time, **fault), 11))


@pytest.mark.parametrize(
    "fault",
    [
        {"lid": 0.11},
        {"lid": -0.06},
        {"speed": 0.3},
        {"speed": float("nan")},
        {"lid": float("nan")},
        {"pose": factories.pose(0.2)},
        {"pose": factories.pose(z=0.2)},
        {"pose": np.full((4, 4), np.nan)},
    ],
    ids=["not there", "past its limit", "passing", "NaN speed", "NaN", "dragged", "carried away", "NaN pose"],
)
def test_what_is_not_closing_never_counts(fault):
    assert not any(verdicts(CLOSE, case(lid=1.5), lambda time: case(time, **fault), 40))


def test_a_case_that_is_tipped_over_is_not_closed():
    tipped = np.eye(4)
    tipped[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    assert not holds(CLOSE, case(lid=1.5), case(pose=tipped))
    assert holds(CLOSE, case(lid=1.5), case(pose=factories.pose(0.05, yaw=3.0)))


def test_a_lid_that_swings_through_its_command_never_counts():
    task = CLOSE.model_copy(update={"goal": ArticulateGoal(joints={"lid": 0.8}, tolerance=0.1)})
    assert not any(verdicts(task, case(lid=1.5), lambda time: case(time, lid=1.5 - 0.3 * time, speed=-0.3), 60))


def test_every_joint_that_is_asked_for_must_be_there():
    task = CLOSE.model_copy(update={"goal": ArticulateGoal(joints={"lid": 0.0, "latch": 1.0}, tolerance=0.1)})
    start = case(lid=1.5, latch=0.0)
    assert not holds(task, start, case(lid=0.0, latch=0.0))
    assert not holds(task, start, case(lid=0.5, latch=1.0))
    assert holds(task, start, case(lid=0.0, latch=1.0))


def test_what_held_at_the_reset_never_counts():
    judge = Judge(CLOSE, case(lid=0.05))
    assert judge.held_at_reset
    assert not any(judge.update(case(PERIOD_S * step)) for step in range(40))


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.sampled_from([0.1, 0.25, 0.5]))
def test_success_is_an_unbroken_run_at_the_end(held, hold_s):
    task = CLOSE.model_copy(update={"hold_s": hold_s})
    states = iter(held)
    found = verdicts(task, case(lid=1.5), lambda time: case(time, lid=0.0 if next(states) else 1.0), len(held))
    need = round(hold_s / PERIOD_S) + 1
    expected = [all(held[max(0, step - need + 1) : step + 1]) and step + 1 >= need for step in range(len(held))]
    assert found == expected


def test_thresholds_stand_once_for_every_world():
    """A task says how far and how long; how a hold or a rest is told is the same wherever it runs."""
    fields = set(TaskSpec.model_fields)
    assert not fields & {"slip_m_s", "rest", "stray_m", "tilt_rad", "limit_rad"}
    assert lift.SLIP_M_S > 0
