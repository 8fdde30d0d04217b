"""evaluate.operator_trials: an operator that practised in a twin, there, in another world and through a cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.trials import Operated
from dextera_build.errors import RuleError
from dextera_build.policy.observation import DeployableObservation
from dextera_build.sim.experts import candidates, planning, rehearse
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.testing import RuleRunner
from tests import episodes, factories, gate, openarm_tasks
from tests.robots import robot_recipes
from tests.sim.runtime import cells


@pytest.fixture
def runner(tmp_path: Path) -> RuleRunner:
    return RuleRunner(tmp_path)


class Pushing:
    """Says one joint target, and counts how often it was asked to begin."""

    def __init__(self) -> None:
        self.begun = 0

    def reset(self) -> None:
        self.begun += 1

    def act(self, observation: DeployableObservation) -> np.ndarray:
        return np.array([gate.target(gate.PUSHES)])


def practising(monkeypatch: pytest.MonkeyPatch, runner: RuleRunner, operator: Pushing) -> list[str]:
    """Put an operator in the place of a rehearsed one; the list is of the worlds in which somebody practised."""
    practised: list[str] = []
    module = runner.find("evaluate.operator_trials").backends["mujoco"].module
    monkeypatch.setattr(module, "_practised", lambda ctx, twin: practised.append(twin.kind) or operator)
    return practised


@pytest.mark.slow
def test_one_rehearsal_serves_all_worlds_and_all_begin_at_the_same_draws(runner, monkeypatch):
    operator = Pushing()
    practised = practising(monkeypatch, runner, operator)
    found: Operated = runner.run(
        "evaluate.operator_trials",
        twin=gate.bundle(),
        world=gate.bundle("reference"),
        cell=cells.cell(),
        options={"trials": 2},
    )
    assert (practised, operator.begun) == (["twin"], 6)
    assert found.cell is not None
    every = (found.twin, found.world, found.cell)
    assert [(each.world, each.poses) for each in every] == [
        ("twin", "exact"),
        ("reference", "exact"),
        ("reference", "tracked"),
    ]
    assert {(each.actor, each.label, each.algorithm) for each in every} == {("policy", "operator", "script")}
    assert len({tuple(trial.seed for trial in each.items) for each in every}) == 1
    assert [trial.start for trial in found.cell.items] == [trial.start for trial in found.world.items]
    assert [each.successes for each in every] == [2, 2, 2]
    # What is measured is judged, too, as evaluate.rollouts does.
    assert [trial.sighting.success for trial in found.cell.items] == [True, True]
    assert runner.outcome.line == (
        "2/2 (34-100 %) in the twin, 2/2 (34-100 %) in the reference, 2/2 (34-100 %) in the reference, poses tracked"
    )


def test_what_failed_keeps_its_reason_and_a_world_without_a_cell_has_no_third_part(runner, monkeypatch):
    practising(monkeypatch, runner, Pushing())
    found = runner.run(
        "evaluate.operator_trials",
        twin=gate.bundle(),
        world=gate.bundle("reference", peg_m=0.05),
        options={"trials": 2},
    )
    assert found.cell is None
    assert found.twin.successes == 2
    assert found.world.reasons == {"not done within 3 s: a joint is not at its command": 2}


def test_an_object_that_is_not_found_is_a_failure(runner, monkeypatch):
    practising(monkeypatch, runner, Pushing())
    found = runner.run(
        "evaluate.operator_trials",
        twin=gate.bundle(),
        world=gate.bundle("reference"),
        cell=cells.cell(loss=1.0, search_s=0.2),
        options={"trials": 1},
    )
    assert found.cell.reasons == {"the tracker did not find the object": 1}
    assert found.world.successes == 1


def test_a_hand_that_cannot_do_the_task_stops_the_build(runner, monkeypatch):
    def breaks(driver, progress, *, anyway):
        assert anyway, "where no rehearsal succeeds, every trial fails and tells the reason"
        raise RuleError("the robot has no frame `tip_thumb`", code="DXB-B252")

    monkeypatch.setattr(planning, "practise", breaks)
    monkeypatch.setattr(
        runner.find("evaluate.operator_trials").backends["mujoco"].module, "Driver", lambda environment: None
    )
    with pytest.raises(RuleError, match="no frame `tip_thumb`"):
        runner.run(
            "evaluate.operator_trials", twin=gate.bundle(), world=gate.bundle("reference"), options={"trials": 2}
        )


@pytest.mark.parametrize("backend", ["mujoco", "stub"])
def test_worlds_that_do_not_belong_together_are_refused(runner, backend):
    twin, world = gate.bundle(), gate.bundle("reference")
    with pytest.raises(RuleError, match="the operator practises in the twin, but the input `twin` is a reference"):
        runner.run("evaluate.operator_trials", backend=backend, twin=world, world=world)
    other = world.model_copy(update={"task": world.task.model_copy(update={"name": "CloseGate"})})
    with pytest.raises(RuleError, match="`twin` is another task than `CloseGate` of the world"):
        runner.run("evaluate.operator_trials", backend=backend, twin=twin, world=other)


def test_the_stub_rehearses_nothing(runner):
    bundle = episodes.bundle()
    found = runner.run("evaluate.operator_trials", profile="stub", twin=bundle, world=bundle, options={"trials": 40})
    assert 28 <= found.twin.successes < 40
    more = runner.run(
        "evaluate.operator_trials", profile="stub", twin=bundle, world=bundle, options={"trials": 4, "twin_trials": 9}
    )
    assert (len(more.twin.items), len(more.world.items)) == (9, 4)
    assert more.world.items == more.twin.items[:4] == found.twin.items[:4]


@pytest.mark.medium
def test_trials_that_were_done_are_not_made_again(tmp_path, monkeypatch):
    given = {"twin": gate.bundle(), "world": gate.bundle("reference"), "options": {"trials": 2}}
    runner = RuleRunner(tmp_path / "whole")
    practising(monkeypatch, runner, Pushing())
    whole = runner.run("evaluate.operator_trials", **given)

    class Tired(Pushing):
        def reset(self) -> None:
            super().reset()
            if self.begun > 3:
                raise KeyboardInterrupt

    parts = RuleRunner(tmp_path / "parts")
    practising(monkeypatch, parts, Tired())
    with pytest.raises(KeyboardInterrupt):
        parts.run("evaluate.operator_trials", **given)
    operator = Pushing()
    practising(monkeypatch, parts, operator)
    assert parts.encode(parts.run("evaluate.operator_trials", **given)) == parts.encode(whole)
    assert operator.begun == 1


@pytest.mark.slow
def test_a_scripted_operator_lifts_a_box_in_a_world_that_is_late(runner, tmp_path, monkeypatch):
    """The whole way, with few candidates: rehearsal, planning from what is measured, inverse kinematics, verdict."""
    for module, name, value in (
        (planning, "PLANNED", 0),
        (candidates, "ENOUGH", 3),
        (candidates, "LOOKED", 40),
        (candidates, "FEW", 2),
    ):
        monkeypatch.setattr(module, name, value)
    for name, value in (("TRIED", 3), ("FINAL", 1), ("STARTS", 1)):
        monkeypatch.setattr(rehearse, name, value)
    box = factories.box_asset(factories.pose(0.0, 0.16), size=(0.05, 0.05, 0.12), mass=0.15)
    robot = robot_recipes.built("openarm_revo1", tmp_path)
    twin = openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), {"box": box}, "box", limbs=("left",))
    world = twin.model_copy(update={"kind": "reference", "latency_s": 0.01})
    found = runner.run("evaluate.operator_trials", twin=twin, world=world, options={"trials": 2})
    assert found.twin.successes + found.world.successes >= 2, (found.twin.reasons, found.world.reasons)
    assert all(trial.steps > 20 for trial in (*found.twin.items, *found.world.items))
