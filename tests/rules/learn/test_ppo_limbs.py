"""learn.ppo: which limbs its policies move, and whether they turn palms and close hands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.control.steering import Steering
from dextera_build.sim.primitives.handover.primitive import HandoverGoal
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.pick_and_reorient.primitive import ReorientGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.testing import RuleRunner
from tests import factories, openarm_tasks, task_bundles
from tests.robots import robot_recipes

FEW = {"steps": 2, "worlds": 2, "rollout": 1, "batch": 2, "epochs": 1, "width": 16}


def contract(tmp_path: Path, bundle: TaskBundle, backend: str = "stub", **options: Any) -> PolicyContract:
    """The contract of a policy that hardly practised."""
    made = RuleRunner(tmp_path).run("learn.ppo", backend=backend, bundle=bundle, options=FEW | options)
    found: PolicyContract = made.contract
    return found


@pytest.mark.medium
def test_both_hands_of_a_task_are_moved(tmp_path: Path) -> None:
    """Three decisions for each palm and one for each hand's fingers, in the order of the task's roles."""
    robot = robot_recipes.built("openarm_revo1", tmp_path)
    box = factories.box_asset(factories.pose(0.0, 0.0), size=(0.05, 0.2, 0.12), mass=0.15)
    both = openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), {"box": box}, "box", limbs=("left", "right"))
    given = both.task.model_copy(update={"goal": HandoverGoal(giver="right", receiver="left"), "limbs": ()})
    one = both.task.model_copy(update={"limbs": ()})
    found = {}
    for name, task in (("both", both.task), ("given", given), ("one", one)):
        bundle = both.model_copy(update={"task": task})
        found[name] = contract(tmp_path, bundle, privileged=name == "both")
    settings = {name: each.settings for name, each in found.items()}
    assert [settings[name]["limb"] for name in found] == ["left right", "right left", "left"]
    assert [settings[name]["decisions"] for name in found] == [8, 8, 4]
    steering = Steering(robot, found["both"])
    home = np.array(found["both"].action.mean)
    sent = steering.targets(np.array([0, 0, 1.0, 0, 0, 1.0, 1.0, 0.0]), home, home)[-1]
    moved = {name for name, way in zip(found["both"].action.names, sent - home, strict=True) if abs(way) > 1e-6}
    left, right = robot.limbs["left"], robot.limbs["right"]
    assert moved & {*left.arm}
    assert moved & {*right.arm}
    assert moved & {*left.hand}
    assert not moved & {*right.hand}


@pytest.mark.medium
def test_of_limbs_that_no_task_names_the_nearest_one_is_moved(tmp_path: Path) -> None:
    """The base faces along x of the world, so that the left arm is at greater y."""
    robot = robot_recipes.built("openarm_revo1", tmp_path)
    found = []
    for y in (0.2, -0.2):
        box = factories.box_asset(factories.pose(0.0, y), size=(0.05, 0.05, 0.12), mass=0.15)
        bundle = openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), {"box": box}, "box")
        found.append(contract(tmp_path, bundle, "sb3").settings["limb"])
    assert found == ["left", "right"]


def test_a_palm_turns_if_the_goal_names_an_orientation_of_what_it_carries(tmp_path: Path) -> None:
    tolerance = Tolerance(position_m=0.04, rotation_rad=0.3)
    placed = ReorientGoal(place_m=(0.0, 0.0, 0.2), tolerance=tolerance)
    turned = placed.model_copy(update={"quaternion": (0.7071068, 0.0, 0.0, -0.7071068)})

    def settings(goal: Goal, **options: float) -> dict[str, Any]:
        lift = task_bundles.lift()
        bundle = lift.model_copy(update={"task": lift.task.model_copy(update={"goal": goal})})
        return contract(tmp_path, bundle, **options).settings

    assert settings(turned)["turn_rad"] == 0.3
    assert settings(turned)["decisions"] == settings(placed)["decisions"] + 3
    assert "turn_rad" not in settings(placed)
    assert "turn_rad" not in settings(turned, turn_rad=0.0)
    assert settings(placed, turn_rad=0.1)["turn_rad"] == 0.1
