"""Worlds on tensors: the conditions of primitives judge them as they judge arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dextera_build.artifacts.tasks.task import TaskSpec
from dextera_build.sim.control.steering import Steering
from dextera_build.sim.primitives import base
from dextera_build.sim.primitives.state import TaskState, stacked
from dextera_build.sim.primitives.success import Judge
from dextera_build.sim.training.tensors.cells import cells, on_tensors
from dextera_build.sim.training.tensors.judge import TensorJudge, tensors
from dextera_build.sim.training.tensors.steering import TensorSteering
from dextera_build.testing import RuleRunner
from tests import task_bundles
from tests.sim.primitives import test_pick_and_place, test_success
from tests.sim.primitives.test_worlds import LIFT, LIFTED, ON_EVERY_TASK
from tests.sim.primitives.traces import Trace, box

OBJECTS = {"box": box(), "tray": test_pick_and_place.tray()}
REACH_M = 0.05


def moved(state: Any) -> Any:
    """The same states as tensors."""
    if isinstance(state, np.ndarray):
        found = torch.from_numpy(np.array(state))
        return cells(found.to(torch.float32) if found.dtype == torch.float64 else found)
    if isinstance(state, Mapping):
        return {name: moved(each) for name, each in state.items()}
    assert is_dataclass(state)
    parts: Any = type(state)
    return parts(*(moved(getattr(state, each.name)) for each in fields(state) if each.init))


def judged_alike(task: TaskSpec, states: list[TaskState]) -> np.ndarray:
    """Successes (T, N), the same by arrays and by tensors, as are the values."""
    one, other = Judge(task, states[0], OBJECTS), TensorJudge(task, moved(states[0]), OBJECTS)
    reach_m = np.full(len(states[0].time_s), REACH_M)
    done = []
    for state in states[1:]:
        here, there = one.update(state), other.update(moved(state))
        assert here.tolist() == there.tolist()
        value = other.value(torch.from_numpy(reach_m).float(), moved(state), there)
        wanted = one.primitive.value(reach_m, states[0], state, here)
        np.testing.assert_allclose(value.numpy(), wanted, atol=2e-4)
        aim, named = other.aims(moved(state))[0], one.primitive.reaching(state)
        assert (aim is None) == (named is None and one.primitive.pushed(states[0], state) is None)
        done.append(here)
    return np.array(done)


@pytest.mark.medium
@ON_EVERY_TASK
def test_tensors_are_judged_as_arrays(task: TaskSpec, traces: Mapping[str, Trace]) -> None:
    length = max(len(trace.states) for trace in traces.values())
    episodes = [[trace.states[0]] * (length - len(trace.states)) + trace.states for trace in traces.values()]
    done = judged_alike(task, [stacked(states) for states in zip(*episodes, strict=True)])
    assert done.any(axis=0).tolist() != [done.any()] * len(traces), "the worlds fare differently"


def test_joints_on_tensors_are_judged_as_arrays() -> None:
    def states(rest: float) -> list[TaskState]:
        return [test_success.case(0.05 * step, lid=max(rest, 1.5 - 0.1 * step), latch=0.5) for step in range(40)]

    goal = test_success.CLOSE.goal.model_copy(update={"joints": {"lid": 0.0, "latch": 0.5}})
    task = test_success.CLOSE.model_copy(update={"goal": goal})
    done = judged_alike(task, [stacked(pair) for pair in zip(states(0.0), states(0.7), strict=True)])
    assert done[-1].tolist() == [True, False]


def test_a_world_that_begins_anew_forgets_and_the_others_do_not() -> None:
    trace = LIFTED["lifted"].states
    both = [moved(stacked([state, state])) for state in trace]
    judge = TensorJudge(LIFT, both[0], OBJECTS)
    for state in both[1:-1]:
        judge.update(state)
    judge.begin(torch.tensor([True, False]), both[0])
    assert judge.update(both[-1]).tolist() == [False, True]
    assert {name.split(".")[1] for name, _ in tensors(judge.state)} == {"start", "past", "held", "since"}


def test_arrays_give_the_same_while_tensors_are_judged() -> None:
    trace = LIFTED["lifted"].states
    judge = Judge(LIFT, trace[0], OBJECTS)
    with on_tensors(judge.primitive):
        assert base.np is not np
        done = [bool(judge.update(state)[0]) for state in trace[1:]]
    again = Judge(LIFT, trace[0], OBJECTS)
    assert base.np is np
    assert done == [bool(again.update(state)[0]) for state in trace[1:]]
    assert any(done)


@pytest.mark.medium
@pytest.mark.parametrize("options", [{}, {"closes": True, "turn_rad": 0.3}, {"control": "joints"}], ids=str)
def test_decisions_on_tensors_lead_where_those_of_arrays_do(options: dict[str, Any], tmp_path: Path) -> None:
    bundle = task_bundles.lift()
    contract = RuleRunner(tmp_path).run("learn.ppo", backend="stub", bundle=bundle, options=options).contract
    one, other = Steering(bundle.robot, contract), TensorSteering(bundle.robot, contract, torch.device("cpu"))
    random = np.random.default_rng(0)
    joints = np.array([[random.uniform(each.lower, each.upper) for each in bundle.robot.joints] for _ in range(16)])
    sent, decisions = joints + random.normal(0.0, 0.01, joints.shape), random.uniform(-1.2, 1.2, (16, one.size))
    wanted = [one.targets(*each) for each in zip(decisions, sent, joints, strict=True)]
    found = other.targets(*(torch.tensor(each, dtype=torch.float32) for each in (decisions, sent, joints)))
    np.testing.assert_allclose(found.transpose(0, 1).numpy(), np.stack(wanted), atol=1e-4)
