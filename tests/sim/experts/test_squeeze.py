"""Two hands on one object: where they press, and that they lift it together."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.experts import planning
from dextera_build.sim.experts.candidates import Search
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.pushing import Pushed
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.squeeze import PRESS_M, squeezes
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks
from tests.robots import robot_recipes

SIZE_M = (0.158, 0.21, 0.06)
PLACES = {"left": np.array([0.0, 0.3, 0.1]), "right": np.array([0.0, -0.3, 0.1])}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))


@pytest.mark.medium
def test_hands_press_towards_one_another_and_take_their_own_sides(robot: RobotModel) -> None:
    box = factories.box_asset(size=SIZE_M)
    points = openarm_tasks.described(box).points.astype(np.float64)
    reach = Reach(robot, "left", "right")
    tips = {limb: reach.one(limb).fingers.reach(Pushed(reach.one(limb)).fingers) for limb in reach.limbs}
    found = list(squeezes(points, reach, PLACES))
    assert len({each.way for each in found}) > 3
    for squeeze in found:
        touch = {limb: transforms.apply(side.palm, tips[limb]) for limb, side in squeeze.sides.items()}
        way = touch["right"] - touch["left"]
        away = [side.away / np.linalg.norm(side.away) for side in squeeze.sides.values()]
        assert away[0] @ away[1] == pytest.approx(-1.0), squeeze.name
        assert way @ squeeze.sides["right"].away > 0, squeeze.name
        # Both beside the object, within the radius of a fingertip and the sampling of its surface.
        assert 0.13 < np.linalg.norm(way) < 0.30, squeeze.name
        assert touch["left"][1] >= touch["right"][1] - 1e-9, squeeze.name
        legs = squeeze.lifting("box", np.eye(4), np.array([0.0, 0.0, 1.0]), 0.1)
        ends = {limb: {leg.segment: leg for leg in legs[limb]} for limb in legs}
        closer = [ends[limb]["grasp"].palm[:3, 3] - legs[limb][2].palm[:3, 3] for limb in ("left", "right")]
        assert [float(np.linalg.norm(each)) for each in closer] == pytest.approx([PRESS_M] * 2)
        assert closer[0] @ way > 0 > closer[1] @ way


@pytest.mark.slow
def test_two_hands_lift_a_packet_that_is_too_wide_for_one(robot: RobotModel) -> None:
    box = factories.box_asset(factories.pose(0.02, 0.0), size=SIZE_M, mass=0.41)
    goal = LiftGoal(height_m=0.1)
    bundle = openarm_tasks.bundle(robot, goal, {"box": box}, "box", limbs=("left", "right"), timeout_s=10.0)
    driver = Driver(Environment(bundle))
    reach = Reach(robot, "left", "right")
    rims, (limbs, expert) = planning.teams(driver.environment)
    assert set(limbs) == {"left", "right"} == set(rims[0])
    found = expert.plan(Search(driver.environment, reach, CollisionCheck(driver.environment, reach), driver.state()))
    start = starts.photographed(bundle, driver.environment.model)
    episodes = [driver.run(each.operator, start, origin="operator") for each in found[:3]]
    assert any(episode.success for episode in episodes), [episode.reason for episode in episodes]
    assert {limb for limb, grasp in driver.environment.state().grasps.items() if grasp.presses[0]} == {"left", "right"}
