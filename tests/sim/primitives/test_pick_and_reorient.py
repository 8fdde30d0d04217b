"""What looks like a reorientation to a judge who only compares poses."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.geometry import quaternions
from dextera_build.sim.primitives.catalogue import of
from dextera_build.sim.primitives.pick_and_reorient.primitive import ReorientGoal
from dextera_build.sim.primitives.poses import Tolerance
from tests.sim.primitives.traces import AWAY, FREE, HOLD, POKE, SET, Trace, about, box

TURN = about(0, np.pi / 2)
QUATERNION = tuple(quaternions.from_matrix(TURN).tolist())
THERE = (0.0, 0.1, 0.15)
GOAL = ReorientGoal(place_m=THERE, quaternion=QUATERNION, tolerance=Tolerance(position_m=0.02, rotation_rad=0.2))
TASK = TaskSpec(name="TurnBox", object="box", goal=GOAL)


def naive(trace: Trace) -> bool:
    """The last pose is the target's."""
    pose = trace.states[-1].world_from_object[0]
    return bool(np.linalg.norm(pose[:3, 3] - THERE) <= 0.02) and np.allclose(pose[:3, :3], TURN, atol=0.1)


def test_an_honest_reorientation_counts() -> None:
    trace = Trace().stay(2).go(THERE, 30, TURN, right=HOLD).stay(12, right=HOLD)
    assert naive(trace)
    assert trace.succeeds(TASK)


CHEATS = {
    "thrown": Trace().go((0, 0.1, 0.1), 4, right=HOLD).go(THERE, 4, TURN, right=FREE).stay(12, right=FREE),
    "laid on something": Trace().go(THERE, 30, TURN, right=HOLD).stay(12),
    "pinned against something": Trace().go(THERE, 30, TURN, right=SET).stay(12, right=SET),
    "on one finger": Trace().go(THERE, 30, TURN, right=POKE).stay(12, right=POKE),
    "teleported": Trace().stay(2, right=HOLD).go(THERE, 1, TURN, right=HOLD).stay(12, right=HOLD),
    "held by nobody": Trace().go(THERE, 30, TURN, right=AWAY).stay(12, right=AWAY),
    "too short": Trace().go(THERE, 30, TURN, right=HOLD).stay(8, right=HOLD),
}


@pytest.mark.parametrize("name", CHEATS)
def test_what_is_not_held_at_its_target_is_refused(name: str) -> None:
    assert naive(CHEATS[name])
    assert not CHEATS[name].succeeds(TASK)


def test_the_place_without_the_turn_is_not_enough() -> None:
    trace = Trace().go(THERE, 30, about(0, 1.0), right=HOLD).stay(12, right=HOLD)
    assert trace.verdict(TASK) == (False, "the object is not at its target")


def test_a_turn_anywhere_must_be_off_the_support() -> None:
    task = TASK.model_copy(update={"goal": GOAL.model_copy(update={"place_m": None})})
    assert Trace().go((0.3, 0.3, 0.2), 30, TURN, right=HOLD).stay(12, right=HOLD).succeeds(task)
    assert not Trace().go((0.3, 0.3, 0.02), 30, TURN, right=SET).stay(12, right=SET).succeeds(task)


def test_the_wrong_hand_is_refused_and_so_is_a_helping_one() -> None:
    task = TASK.model_copy(update={"limbs": ("left",)})
    both = ("left", "right")

    def held(**hands: object) -> Trace:
        return Trace(both).go(THERE, 30, TURN, **hands).stay(12, **hands)

    assert held(left=HOLD).succeeds(task)
    assert not held(right=HOLD).succeeds(task)
    assert not held(left=HOLD, right=HOLD).succeeds(task)
    assert held(left=HOLD, right=HOLD).succeeds(TASK.model_copy(update={"limbs": both}))
    assert held(left=HOLD, right=HOLD).succeeds(TASK)


def test_only_what_is_held_gains_by_coming_nearer() -> None:
    primitive = of(TASK, {"box": box()})
    start = Trace().states[0]
    held, flying = (Trace().go(THERE, 10, TURN, right=grasp).states[-1] for grasp in (HOLD, FREE))
    reached, pending = np.zeros(1), np.zeros(1, bool)
    assert primitive.value(reached, start, held, pending) > primitive.value(reached, start, flying, pending) + 3
