"""What is refused as out of reach: nothing that an arm of these lengths can reach, and what is far beyond."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.model import reach
from dextera_build.sim.primitives import within_reach
from dextera_build.sim.primitives.base import UnfitError
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.poses import Tolerance
from tests import episodes, factories, openarm_tasks
from tests.robots.robot_recipes import built

NEAR = Tolerance(position_m=0.02, rotation_rad=0.2)
REACH_M = 0.15 + 0.25 + float(np.hypot(0.2, 0.015))
"""Of the arm, from its first joint, 0.1 m above the base."""


def task(goal: Goal, limbs: tuple[str, ...] = ()) -> TaskBundle:
    bundle = episodes.bundle()
    spec = bundle.task.model_copy(update={"goal": goal, "limbs": limbs})
    return bundle.model_copy(update={"task": spec})


def place(away_m: float) -> tuple[float, float, float]:
    """A place this far from the arm's first joint, at its height."""
    x, y, z = (episodes.WORLD_FROM_BASE @ [away_m, 0.0, 0.1, 1.0])[:3].tolist()
    return x, y, z


@pytest.mark.parametrize("limbs", [(), ("arm",)])
def test_a_place_at_the_end_of_the_arm_passes_and_one_far_beyond_does_not(limbs: tuple[str, ...]) -> None:
    within_reach.check(task(PlaceGoal(place_m=place(REACH_M), tolerance=NEAR), limbs))
    with pytest.raises(UnfitError, match="the target of `LiftBox` is out of reach of limb `arm`") as caught:
        within_reach.check(task(PlaceGoal(place_m=place(REACH_M + 0.4), tolerance=NEAR), limbs))
    assert caught.value.facts["distance"] == f"{REACH_M + 0.4:.2f} m from `joint_1`"


def test_a_lift_may_bring_the_object_over_the_robot() -> None:
    within_reach.check(task(LiftGoal(height_m=0.1 + REACH_M)))
    with pytest.raises(UnfitError) as caught:
        within_reach.check(task(LiftGoal(height_m=0.5 + REACH_M)))
    assert caught.value.facts["place"].startswith("z ")


def test_a_container_counts_where_it_stands() -> None:
    bundle = task(PlaceGoal(into="case", tolerance=NEAR))
    within_reach.check(bundle)
    case = bundle.objects["case"]
    far = case.pose.matrix.copy()
    far[0, 3] += 3.0
    moved = case.model_copy(update={"pose": case.pose.model_copy(update={"matrix": far})})
    with pytest.raises(UnfitError, match="the target of"):
        within_reach.check(bundle.model_copy(update={"objects": {**bundle.objects, "case": moved}}))


@pytest.mark.medium
def test_of_several_limbs_one_that_reaches_is_enough_unless_all_are_named(tmp_path: Path) -> None:
    robot = built("openarm_revo1", tmp_path)
    box = factories.box_asset(place=factories.pose(0.05, 0.0), mass=0.2)
    bounds = {limb: reach.of_limb(robot, limb) for limb in robot.limb_names}
    assert bounds["left"] is not None
    # Beside the left shoulder, which is 0.19 m from the right one: the ends of the two arms differ by as much.
    x, y, z = (openarm_tasks.BASE @ [*bounds["left"].centre_m, 1.0])[:3].tolist()
    place = x, y + bounds["left"].radius_m + 0.25, z

    def checked(limbs: tuple[str, ...]) -> None:
        goal = PlaceGoal(place_m=place, tolerance=NEAR)
        within_reach.check(openarm_tasks.bundle(robot, goal, {"box": box}, "box", limbs=limbs))

    checked(())
    checked(("left",))
    for limbs in (("right",), ("left", "right")):
        with pytest.raises(UnfitError, match="out of reach of limb `right`"):
            checked(limbs)
