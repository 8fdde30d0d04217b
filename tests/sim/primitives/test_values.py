"""The value of every primitive rises towards success, is bounded, and is highest at success."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives import folders
from dextera_build.sim.primitives.catalogue import of
from dextera_build.sim.primitives.stages import DONE, HOLD, MOVE, REACH
from dextera_build.sim.primitives.state import GraspState, TaskState
from tests.sim.primitives import test_handover, test_pick_and_place, test_pick_and_reorient, test_push, test_success
from tests.sim.primitives.test_handover import POKE_IN_AIR, UP
from tests.sim.primitives.traces import AWAY, HALF_M, POKE, SET, Trace, box
from tests.sim.primitives.traces import HOLD as HELD

Way = Sequence[tuple[float, TaskState]]
"""Distances of the fingertips [m] and states on the way to success."""
TABLE = (0.0, 0.0, HALF_M)


def at(
    place: Sequence[float] = TABLE,
    turn: np.ndarray | None = None,
    hands: tuple[str, ...] = ("right",),
    **grasps: GraspState,
) -> TaskState:
    """The box at a place, in these grasps."""
    return Trace(hands, {"tray": test_pick_and_place.TRAY}).go(place, 1, turn, **grasps).states[-1]


def given_at(place: Sequence[float] = UP, **grasps: GraspState) -> TaskState:
    """The box at a place, in these grasps of two hands."""
    return at(place, None, test_handover.HANDS, **grasps)


GRASPED: Way = [(0.7, at()), (0.1, at()), (0.0, at(right=POKE)), (0.0, at(right=SET))]
THERE, LAID = test_pick_and_place.THERE, test_pick_and_place.LAID
LIFT = TaskSpec(name="Lift", object="box", goal=test_success.LIFT.goal)
WAYS: dict[str, tuple[TaskSpec, Way]] = {
    "lift": (LIFT, [*GRASPED, *((0.0, at((0, 0, HALF_M + rise), right=HELD)) for rise in (0.03, 0.07, 0.12))]),
    "pick_and_reorient": (
        test_pick_and_reorient.TASK,
        [
            *GRASPED,
            (0.0, at((0.0, 0.05, 0.08), right=HELD)),
            (0.0, at((0.0, 0.09, 0.14), right=HELD)),
            (0.0, at(test_pick_and_reorient.THERE, test_pick_and_reorient.TURN, right=HELD)),
        ],
    ),
    "pick_and_place": (
        test_pick_and_place.TASK,
        [*GRASPED, *((0.0, at((x, 0.0, 0.05), right=HELD)) for x in (0.1, 0.2, 0.3)), (0.1, at(THERE, right=AWAY))],
    ),
    "pick_and_place into": (
        test_pick_and_place.INTO,
        [*GRASPED, *((0.0, at((x, 0.0, 0.1), right=HELD)) for x in (0.1, 0.2)), (0.1, at(LAID, right=AWAY))],
    ),
    "push": (
        test_push.TASK,
        [
            (0.7, at()),
            (0.0, at(right=POKE)),
            (0.0, at((0.1, 0.0, HALF_M), right=POKE)),
            (0.3, at(test_push.THERE, test_push.TURN, right=AWAY)),
        ],
    ),
    "articulate": (
        test_success.CLOSE,
        [(0.7, test_success.case(lid=1.5)), *((0.0, test_success.case(lid=lid)) for lid in (1.5, 0.8, 0.2, 0.0))],
    ),
    "handover": (
        test_handover.TASK,
        [
            (0.7, given_at(TABLE)),
            (0.1, given_at(TABLE)),
            (0.0, given_at(TABLE, left=SET)),
            *((reach, given_at(left=HELD)) for reach in (2.0, 0.7, 0.2)),
            (0.02, given_at(left=HELD, right=POKE_IN_AIR)),
            (0.0, given_at(left=HELD, right=HELD)),
            (0.0, given_at(right=HELD)),
        ],
    ),
}


def value(task: TaskSpec, way: Way, reach_m: float, state: TaskState, success: bool = False) -> float:
    primitive = of(task, {"box": box(), "tray": test_pick_and_place.tray()})
    return float(primitive.value(np.array([reach_m]), way[0][1], state, np.array([success]))[0])


def test_every_primitive_has_a_way() -> None:
    names = {each.parent.name for each in folders.Path(folders.__file__).parent.glob("*/primitive.py")}
    assert {task.primitive for task, _ in WAYS.values()} == names


@pytest.mark.parametrize("name", WAYS)
def test_every_step_towards_success_is_worth_more(name: str) -> None:
    task, way = WAYS[name]
    values = [value(task, way, *step) for step in way]
    assert all(before + 0.05 < after for before, after in pairwise(values)), values
    assert value(task, way, *way[-1], success=True) == pytest.approx(values[-1] + DONE)


@pytest.mark.medium
@pytest.mark.parametrize("name", WAYS)
@given(reach=st.floats(0.0, 1e6), pick=st.integers(0, 100))
def test_values_are_bounded_and_success_is_best(name: str, reach: float, pick: int) -> None:
    task, way = WAYS[name]
    best = value(task, way, *way[-1], success=True)
    found = value(task, way, reach, way[pick % len(way)][1])
    assert -10.0 < found < best <= REACH + HOLD + MOVE + DONE
    assert found <= value(task, way, 0.0, way[pick % len(way)][1]), "nearer is better"


def test_the_receiver_should_reach_the_object_once_the_giver_holds_it() -> None:
    primitive = of(test_handover.TASK, {"box": box()})
    states = [given_at(TABLE), given_at(TABLE, left=SET), given_at(left=HELD), given_at(right=HELD)]
    assert [str(primitive.reaching(state)[0]) for state in states] == ["left", "left", "right", "left"]
