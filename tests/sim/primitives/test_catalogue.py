"""What every primitive has: a name, options in `simulate.task`, a goal with numbers, a value, a reason."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from dextera_build.artifacts import goals
from dextera_build.artifacts.goals import Goal, HandoverGoal, LiftGoal, PlaceGoal, PushGoal, ReorientGoal, Tolerance
from dextera_build.sim import primitives
from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import factories, task_bundles

NEAR = Tolerance(position_m=0.02, rotation_rad=0.2)
TURN = (0.8, 0.0, 0.6, 0.0)
GOALS: dict[str, Goal] = {
    "lift": LiftGoal(height_m=0.1),
    "push": PushGoal(place_m=(0.3, 0.2), yaw_rad=0.5, upright=(1.0, 0.0, 0.0, 0.0), tolerance=NEAR),
    "pick_and_reorient": ReorientGoal(place_m=(0.1, 0.2, 0.3), quaternion=TURN, tolerance=NEAR),
    "pick_and_place": PlaceGoal(place_m=(0.1, 0.2, 0.02), tolerance=NEAR),
    "handover": HandoverGoal(giver="left", receiver="right"),
}


def test_every_file_with_a_primitive_is_listed() -> None:
    folder = Path(primitives.__path__[0])
    found = set()
    for file in folder.glob("*.py"):
        for node in ast.parse(file.read_text()).body:
            bases = [ast.unparse(base) for base in node.bases] if isinstance(node, ast.ClassDef) else []
            if any(base.startswith("Primitive[") for base in bases):
                found.add(file.stem)
    assert found == set(catalogue.KINDS) == set(get_args(goals.Primitive))


def test_every_parameter_is_an_option_of_the_task(tmp_path: Path) -> None:
    options = RuleRunner(tmp_path).find("simulate.task").rule.options.model_fields
    for kind in catalogue.KINDS.values():
        assert set(kind.parameters.model_fields) <= set(options), kind.name


@pytest.mark.parametrize("name", GOALS)
def test_an_episode_of_every_primitive_runs_and_says_why_it_failed(name: str) -> None:
    bundle = task_bundles.lift()
    goal = GOALS[name]
    task = bundle.task.model_copy(update={"goal": goal, "timeout_s": 0.2})
    environment = Environment(bundle.model_copy(update={"task": task}))
    assert task.primitive == name
    assert len(goal.names) == len(environment.goal) == len(environment.observe()["goal"])
    assert np.isfinite(environment.goal).all()
    assert np.isfinite(Progress(environment).value(False))
    outcome = environment.step(environment.previous_action)
    while not outcome.over:
        outcome = environment.step(environment.previous_action)
    assert not outcome.success
    assert outcome.reason.startswith("not done within 0.2 s: ")
    assert not any(letter.isdigit() for letter in outcome.reason.partition(": ")[2])


@pytest.mark.parametrize("name", ["push", "pick_and_reorient", "pick_and_place"])
def test_policies_see_a_target_in_the_base_wherever_the_robot_stands(name: str) -> None:
    base = factories.pose(0.4, -0.2, 0.1, yaw=0.8)
    numbers = np.array(GOALS[name].numbers(np.linalg.inv(base)))
    place = GOALS[name].place_m  # type: ignore[union-attr]
    seen = np.linalg.inv(base) @ [*place, *([0.0] if len(place) == 2 else []), 1.0]  # type: ignore[misc,arg-type]
    assert numbers[: len(place)] == pytest.approx(seen[: len(place)])  # type: ignore[arg-type]
    moved = np.array(GOALS[name].numbers(np.eye(4)))
    assert not np.allclose(numbers, moved)
