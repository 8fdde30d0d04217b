"""How far an episode came: the last stage of its primitive, on states that are made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.state import stacked
from dextera_build.sim.primitives.success import Judge
from tests import factories
from tests.sim.primitives import test_handover, test_pick_and_place, test_pick_and_reorient, test_push, test_success
from tests.sim.primitives.traces import HALF_M, HOLD, POKE, SET, Trace, box

LIFT = TaskSpec(name="Lift", object="box", goal=LiftGoal(height_m=0.1))
PLACE, INTO, PUSH = test_pick_and_place.TASK, test_pick_and_place.INTO, test_push.TASK
TURN, GIVE = test_pick_and_reorient.TASK, test_handover.TASK
CARRIED, TAKEN, HANDS = test_pick_and_place.carried, test_handover.taken, test_handover.HANDS
BOTH = TAKEN().stay(5, left=HOLD, right=HOLD)
CASES: dict[str, tuple[TaskSpec, Trace, str]] = {
    "lift: nothing": (LIFT, Trace().stay(5), ""),
    "lift: poked": (LIFT, Trace().stay(5, right=POKE), "touched"),
    "lift: grasped": (LIFT, Trace().stay(5, right=SET), "grasped"),
    "lift: too low": (LIFT, Trace().go((0, 0, 0.06), 9, right=HOLD), "off its support"),
    "lift: for a moment": (LIFT, Trace().go((0, 0, 0.2), 9, right=HOLD).go((0, 0, HALF_M), 9), "raised"),
    "lift: pinned high": (LIFT, Trace().go((0, 0, 0.2), 9, right=SET), "grasped"),
    "place: carried elsewhere": (PLACE, CARRIED((0.1, 0.0, 0.1)), "carried"),
    "place: held there": (PLACE, CARRIED(test_pick_and_place.THERE).stay(5, right=SET), "at its target"),
    "place: released": (PLACE, CARRIED(test_pick_and_place.THERE).stay(2, right=SET).stay(3), "released"),
    "place: pushed there": (PLACE, Trace().go(test_pick_and_place.THERE, 60, right=POKE).stay(9), "touched"),
    "place: into the tray": (INTO, CARRIED(test_pick_and_place.LAID).stay(5, right=SET), "at its target"),
    "push: untouched": (PUSH, Trace().go(test_push.THERE, 60), ""),
    "push: a little": (PUSH, Trace().go((0.05, 0, HALF_M), 20, right=POKE), "touched"),
    "push: too far": (PUSH, Trace().go((0.4, 0, HALF_M), 40, test_push.TURN, right=POKE), "halfway"),
    "push: lifted, then there": (PUSH, Trace().go((0, 0, 0.1), 9, right=HOLD).go(test_push.THERE, 9), "touched"),
    "turn: in the hand": (TURN, Trace().go((0, 0, 0.1), 20, right=HOLD), "off its support"),
    "turn: for a moment": (
        TURN,
        Trace().go(test_pick_and_reorient.THERE, 30, test_pick_and_reorient.TURN, right=HOLD),
        "at its target",
    ),
    "give: wrong hand": (GIVE, Trace(HANDS).go(test_handover.UP, 20, right=HOLD), "touched"),
    "give: lifted": (GIVE, TAKEN(), "given"),
    "give: both": (GIVE, BOTH, "in both hands"),
}


@pytest.mark.parametrize("name", CASES)
def test_an_episode_keeps_the_last_stage_that_it_reached(name: str) -> None:
    task, trace, stage = CASES[name]
    assert trace.stage(task, tray=test_pick_and_place.tray()) == stage
    assert not trace.succeeds(task, tray=test_pick_and_place.tray())


def test_a_success_has_passed_all_stages() -> None:
    for task, trace in (
        (LIFT, Trace().go((0, 0, 0.2), 20, right=HOLD).stay(20, right=HOLD)),
        (PLACE, CARRIED(test_pick_and_place.THERE).stay(3, right=SET).stay(12)),
        (PUSH, test_push.pushed().stay(20)),
        (GIVE, TAKEN().stay(5, left=HOLD, right=HOLD).stay(20, right=HOLD)),
    ):
        assert trace.succeeds(task)
        assert trace.stage(task) == catalogue.kind(task.primitive).stages[-1]


@pytest.mark.parametrize(("lid", "stage"), [(1.45, 0), (1.3, 1), (0.7, 2), (0.05, 3)])
def test_joints_come_nearer_in_stages(lid: float, stage: int) -> None:
    judge = Judge(test_success.CLOSE, test_success.case(lid=1.5), staged=True)
    judge.update(test_success.case(0.05, lid=lid))
    judge.update(test_success.case(0.10, lid=1.5))
    assert judge.stage.tolist() == [stage]
    dragged = Judge(test_success.CLOSE, test_success.case(lid=1.5), staged=True)
    dragged.update(test_success.case(0.05, lid=lid, pose=factories.pose(0.3)))
    assert dragged.stage.tolist() == [0]


def test_worlds_come_as_far_together_as_alone() -> None:
    traces = [trace for task, trace, _ in CASES.values() if task is LIFT]
    length = min(len(trace.states) for trace in traces)
    episodes = [trace.states[-length:] for trace in traces]

    def stages(states: list) -> list[int]:
        judge = Judge(LIFT, states[0], {"box": box()}, staged=True)
        for state in states[1:]:
            judge.update(state)
        return judge.stage.tolist()

    together = stages([stacked(states) for states in zip(*episodes, strict=True)])
    assert together == [stage for states in episodes for stage in stages(states)]
    assert len(set(together)) > 2


def test_a_primitive_without_stages_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    trace = Trace().go((0, 0, 0.2), 20, right=HOLD).stay(20, right=HOLD)
    judge = Judge(LIFT, trace.states[0], {"box": box()}, staged=True)
    monkeypatch.setattr(type(judge.primitive), "stages", ())
    monkeypatch.delattr(type(judge.primitive), "reached")
    assert max(judge.update(state)[0] for state in trace.states[1:])
    assert judge.stage.tolist() == [0]
    assert np.array_equal(judge.primitive.reached(trace.states[0], trace.states[-1], judge._past), [0])
