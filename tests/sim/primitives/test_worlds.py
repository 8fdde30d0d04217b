"""Several worlds that are judged and valued in one call fare as each one alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.state import TaskState, stacked
from dextera_build.sim.primitives.success import Judge
from tests.sim.primitives import test_handover, test_pick_and_place, test_pick_and_reorient, test_push, test_success
from tests.sim.primitives.traces import HOLD, POKE, SET, Trace, box

CARRIED = test_pick_and_place.carried
INTO = {
    "placed": CARRIED(test_pick_and_place.LAID).stay(3, right=SET).stay(12),
    "beside": CARRIED((0.4, 0.0, 0.1)).stay(12),
    "held": CARRIED(test_pick_and_place.LAID).stay(20, right=SET),
}
PUSHED = {"pushed": test_push.pushed().stay(20), **test_push.CHEATS}
TURNED = {
    "turned": Trace()
    .go(test_pick_and_reorient.THERE, 30, test_pick_and_reorient.TURN, right=HOLD)
    .stay(20, right=HOLD),
    **test_pick_and_reorient.CHEATS,
}
GIVEN = {
    "given": test_handover.taken().stay(5, left=HOLD, right=test_handover.POKE_IN_AIR).stay(5, left=HOLD, right=HOLD)
    .stay(20, right=HOLD),
    **test_handover.CHEATS,
}  # fmt: skip
LIFTED = {
    "lifted": Trace(test_handover.HANDS).go((0, 0, 0.2), 20, right=HOLD).stay(20, right=HOLD),
    "in both": Trace(test_handover.HANDS).go((0, 0, 0.2), 20, left=HOLD, right=HOLD).stay(20, left=HOLD, right=HOLD),
    "poked": Trace(test_handover.HANDS).go((0, 0, 0.2), 20, right=POKE).stay(20, right=POKE),
}
LIFT = TaskSpec(name="Lift", object="box", goal=LiftGoal(height_m=0.1))


ON_EVERY_TASK = pytest.mark.parametrize(
    ("task", "traces"),
    [
        (test_pick_and_place.INTO, INTO),
        (test_pick_and_place.TASK, INTO),
        (test_push.TASK, PUSHED),
        (test_pick_and_reorient.TASK, TURNED),
        (test_handover.TASK, GIVEN),
        (LIFT, LIFTED),
        (LIFT.model_copy(update={"limbs": ("right",)}), LIFTED),
    ],
    ids=["into", "place", "push", "reorient", "handover", "lift", "lift with one hand"],
)


@ON_EVERY_TASK
def test_worlds_are_judged_together_as_alone(task: TaskSpec, traces: Mapping[str, Trace]) -> None:
    length = min(len(trace.states) for trace in traces.values())
    episodes = [trace.states[-length:] for trace in traces.values()]
    alone = [_judged(task, states) for states in episodes]
    together = _judged(task, [stacked(states) for states in zip(*episodes, strict=True)])
    for number, own in enumerate(alone):
        for ours, theirs in zip(own, together, strict=True):
            assert np.array_equal(ours[:, 0], theirs[:, number]), list(traces)[number]
    assert len({why for _, _, whys in alone for why in whys[:, 0]}) > 1, "the worlds fare differently"


def test_joints_of_worlds_are_judged_together_as_alone() -> None:
    def states(rest: float) -> list[TaskState]:
        return [test_success.case(0.05 * step, lid=max(rest, 1.5 - 0.1 * step), latch=0.5) for step in range(40)]

    goal = test_success.CLOSE.goal.model_copy(update={"joints": {"lid": 0.0, "latch": 0.5}})
    task = test_success.CLOSE.model_copy(update={"goal": goal})
    both = [states(0.0), states(0.7)]
    alone = [_judged(task, each) for each in both]
    together = _judged(task, [stacked(pair) for pair in zip(*both, strict=True)])
    assert together[0][-1].tolist() == [True, False]
    for number, own in enumerate(alone):
        assert all(np.array_equal(a[:, 0], b[:, number]) for a, b in zip(own, together, strict=True))
    primitive = Judge(task, stacked([both[0][0], both[1][0]])).primitive
    pushed = primitive.pushed(stacked([both[0][0], both[1][0]]), stacked([both[0][30], both[1][30]]))
    assert pushed is not None
    assert (pushed[0][1], float(pushed[1][1])) == ("lid", pytest.approx(-0.7))


def _judged(task: TaskSpec, states: list[TaskState]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Successes, values and reasons, (T, N)."""
    judge = Judge(task, states[0], {"box": box(), "tray": test_pick_and_place.tray()})
    reach_m = np.full(len(states[0].time_s), 0.05)
    done, values, reasons = [], [], []
    for state in states[1:]:
        done.append(judge.update(state))
        values.append(judge.primitive.value(reach_m, states[0], state, done[-1]))
        reasons.append(judge.reasons)
    return np.array(done), np.array(values), np.array(reasons)
