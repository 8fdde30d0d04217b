"""What looks like a handover to a judge who only looks which hand holds the object in the end."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives.base import Setting, UnfitError
from dextera_build.sim.primitives.catalogue import of
from dextera_build.sim.primitives.handover.primitive import HandoverGoal, Options
from tests import task_bundles
from tests.sim.primitives.traces import ALONG, FREE, HALF_M, HOLD, SET, Trace, box, grasped

TASK = TaskSpec(name="HandOverBox", object="box", goal=HandoverGoal(giver="left", receiver="right"))
HANDS = ("left", "right")
UP = (0.1, 0.0, 0.2)
TABLE = (0.1, 0.0, HALF_M)


def naive(trace: Trace) -> bool:
    """The receiver holds it, off the table, in the end."""
    return bool(trace.states[-1].grasps["right"].alone[0])


def taken() -> Trace:
    return Trace(HANDS).stay(2).go(UP, 20, left=HOLD)


def test_an_honest_handover_counts() -> None:
    trace = taken().stay(5, left=HOLD, right=POKE_IN_AIR).stay(5, left=HOLD, right=HOLD).stay(12, right=HOLD)
    assert trace.succeeds(TASK)


POKE_IN_AIR = grasped(fingers=1, supported=False, pushes=ALONG[:1])


CHEATS = {
    "from the table": Trace(HANDS).stay(2).go(UP, 20, right=HOLD).stay(12, right=HOLD),
    "put down between": taken().go(TABLE, 20, left=HOLD).stay(3, left=SET).stay(3).stay(3, right=SET)
    .go(UP, 20, right=HOLD).stay(12, right=HOLD),
    "put down in both hands": taken().stay(3, left=HOLD, right=HOLD).go(TABLE, 20, left=SET, right=SET)
    .stay(2, right=SET).go(UP, 20, right=HOLD).stay(12, right=HOLD),
    "thrown": taken().go((0.2, 0.0, 0.25), 4, left=FREE).stay(12, right=HOLD),
    "dropped and caught": taken().stay(3, left=HOLD, right=HOLD).go((0.1, 0, 0.15), 2, left=FREE)
    .stay(12, right=HOLD),
    "never in both hands": taken().stay(12, right=HOLD),
    "for a moment": taken().stay(5, left=HOLD, right=HOLD).stay(8, right=HOLD),
    "teleported": taken().stay(3, left=HOLD, right=HOLD).go((0.9, 0.0, 0.2), 1, right=HOLD).stay(12, right=HOLD),
}  # fmt: skip


@pytest.mark.parametrize("name", CHEATS)
def test_what_is_not_a_handover_is_refused(name: str) -> None:
    assert naive(CHEATS[name])
    assert not CHEATS[name].succeeds(TASK)


def test_a_giver_that_does_not_let_go_has_not_given() -> None:
    trace = taken().stay(30, left=HOLD, right=HOLD)
    assert trace.verdict(TASK) == (False, "the giver did not let go")
    still = taken().stay(5, left=HOLD, right=HOLD).stay(30, left=POKE_IN_AIR, right=HOLD)
    assert not still.succeeds(TASK)


def test_the_other_way_round_is_another_task() -> None:
    trace = Trace(HANDS).stay(2).go(UP, 20, right=HOLD).stay(5, left=HOLD, right=HOLD).stay(12, left=HOLD)
    assert not trace.succeeds(TASK)
    back = TASK.model_copy(update={"goal": HandoverGoal(giver="right", receiver="left")})
    assert trace.succeeds(back)


def test_a_receiver_that_grasps_badly_has_not_taken() -> None:
    trace = taken().stay(5, left=HOLD, right=POKE_IN_AIR).stay(12, right=POKE_IN_AIR)
    assert not trace.succeeds(TASK)


def test_every_stage_is_worth_more_than_the_one_before() -> None:
    primitive = of(TASK, {"box": box()})
    trace = taken().stay(1, left=HOLD, right=POKE_IN_AIR).stay(1, left=HOLD, right=HOLD).stay(1, right=HOLD)
    states = [trace.states[row] for row in (0, -4, -3, -2, -1)]
    values = [float(primitive.value(np.zeros(1), states[0], state, np.zeros(1, bool))[0]) for state in states]
    assert values == sorted(set(values))


def test_a_robot_with_one_hand_hands_nothing_over() -> None:
    setting = Setting("Task", "box", {}, {}, task_bundles.robot())
    with pytest.raises(UnfitError, match="names its hands"):
        Options().goal(setting)
    with pytest.raises(UnfitError, match="no limb `left`"):
        Options(giver="left").goal(setting)
