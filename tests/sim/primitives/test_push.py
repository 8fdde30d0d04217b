"""What looks like a push that was done to a judge who only compares the last pose with the target."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives.catalogue import of
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.primitives.push.primitive import PushGoal
from tests.sim.primitives.traces import AWAY, FREE, HALF_M, HOLD, POKE, Trace, about, box

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
GOAL = PushGoal(
    place_m=(0.2, 0.0), yaw_rad=0.5, upright=UPRIGHT, tolerance=Tolerance(position_m=0.02, rotation_rad=0.2)
)
TASK = TaskSpec(name="PushBox", object="box", goal=GOAL)
THERE = (0.2, 0.0, HALF_M)
TURN = about(2, 0.5)


def naive(trace: Trace) -> bool:
    """The last pose is the target's."""
    pose = trace.states[-1].world_from_object[0]
    return bool(np.linalg.norm(pose[:2, 3] - GOAL.place_m) <= 0.02)


def pushed(**changed: object) -> Trace:
    return Trace().stay(5).go(THERE, 40, TURN, right=POKE, **changed)


def test_an_honest_push_counts() -> None:
    assert pushed().stay(12).succeeds(TASK)
    assert pushed().stay(12, right=POKE).succeeds(TASK), "a hand may stay at the object"


CHEATS = {
    "the object jumped": Trace().stay(3, right=POKE).go(THERE, 1, TURN).stay(20),
    "the object was not pushed": Trace().go(THERE, 40, TURN).stay(20),
    "the object was lifted": Trace().go((0.1, 0.0, 0.1), 20, right=HOLD).go(THERE, 20, TURN, right=HOLD).stay(20),
    "thrown": Trace().stay(2, right=POKE).go((0.1, 0, 0.05), 4, right=FREE).go(THERE, 4, TURN, right=FREE).stay(20),
    "carried low": Trace().go((0.1, 0.0, HALF_M + 0.01), 20, right=HOLD).go(THERE, 20, TURN, right=HOLD).stay(20),
    "on something": Trace().go((0.2, 0.0, HALF_M + 0.02), 40, TURN, right=POKE).stay(20),
    "in the air": Trace().go(THERE, 40, TURN, right=POKE).stay(20, right=FREE),
    "wrong turn": Trace().go(THERE, 40, about(2, -0.5), right=POKE).stay(20),
    "tipped over": Trace().go(THERE, 40, TURN @ about(0, 1.5), right=POKE).stay(20),
    "too short": Trace().go(THERE, 40, TURN, right=POKE).stay(8),
}


@pytest.mark.parametrize("name", CHEATS)
def test_what_is_not_a_push_is_refused(name: str) -> None:
    trace = CHEATS[name]
    assert abs(trace.states[-1].place[0, 0] - 0.2) < 0.02
    assert naive(trace)
    succeeded, reason = trace.verdict(TASK)
    assert not succeeded
    if name.startswith("the object"):
        assert reason == name


def test_a_push_with_the_wrong_hand_is_refused() -> None:
    task = TASK.model_copy(update={"limbs": ("left",)})
    both = ("left", "right")
    assert Trace(both).stay(2).go(THERE, 40, TURN, left=POKE).stay(12).succeeds(task)
    wrong = Trace(both).stay(2).go(THERE, 40, TURN, right=POKE).stay(12)
    assert naive(wrong)
    assert wrong.verdict(task) == (False, "another hand touched the object")


def test_passing_through_the_target_is_no_push() -> None:
    trace = Trace().go((0.4, 0.0, HALF_M), 40, TURN, right=POKE).stay(20)
    assert any(abs(state.place[0, 0] - 0.2) < 0.02 for state in trace.states)
    assert not trace.succeeds(TASK.model_copy(update={"goal": GOAL.model_copy(update={"yaw_rad": None})}))


def test_unknown_poses_never_count() -> None:
    trace = Trace().stay(2, right=POKE).go((np.nan, 0.0, HALF_M), 20, right=POKE)
    assert not trace.succeeds(TASK)


@pytest.mark.parametrize(("symmetry", "counts"), [(1, False), (2, False), (4, True), (0, True)])
def test_orientations_that_look_alike_are_alike(symmetry: int, counts: bool) -> None:
    alike = GOAL.tolerance.model_copy(update={"symmetry": symmetry})
    task = TASK.model_copy(update={"goal": GOAL.model_copy(update={"tolerance": alike})})
    trace = Trace().stay(2).go(THERE, 40, about(2, 0.5 + np.pi / 2), right=POKE).stay(12)
    assert trace.succeeds(task) is counts


def test_nearer_is_worth_more_and_flying_nothing() -> None:
    primitive = of(TASK, {"box": box()})
    states = Trace().stay(1).go(THERE, 10, TURN, right=POKE).states
    reached, pending = np.zeros(1), np.zeros(1, bool)
    values = [primitive.value(reached, states[0], state, pending) for state in states[1:]]
    assert values == sorted(values)
    high = Trace().go((0.2, 0.0, 0.2), 10, TURN, right=POKE).states[-1]
    assert primitive.value(reached, states[0], high, pending) < values[-1]
    assert primitive.fair({"box": states[0].world_from_object})
    assert not primitive.fair({"box": states[-1].world_from_object})
    assert AWAY.supported
