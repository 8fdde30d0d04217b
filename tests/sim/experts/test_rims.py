"""Two hands at the rim of one vessel: where they pinch, and that they lift it together."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import State
from dextera_build.sim.experts.candidates import Search
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.rehearse import Planned
from dextera_build.sim.experts.rims import Rims, by_rims
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.lift.script import LiftTogether
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks
from tests.robots import robot_recipes

RADIUS_M, HEIGHT_M = 0.115, 0.10
"""Of a vessel that is too wide for one hand."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def driver(robot: RobotModel) -> Driver:
    basket = factories.bowl_asset(factories.pose(0.0, 0.0), radius=RADIUS_M, height=HEIGHT_M, mass=0.35)
    goal = LiftGoal(height_m=0.1)
    bundle = openarm_tasks.bundle(robot, goal, {"basket": basket}, "basket", limbs=("left", "right"), timeout_s=10.0)
    driver = Driver(Environment(bundle))
    driver.environment.begin(starts.photographed(bundle, driver.environment.model))
    return driver


def found(driver: Driver, robot: RobotModel) -> tuple[list[Rims], list[Planned]]:
    """Pairs of grasps, and the operators with them."""
    reach, environment = Reach(robot, "left", "right"), driver.environment
    made: dict[int, Rims] = {}

    def operator(way: Rims) -> Planned:
        lift = LiftTogether(environment, reach, way)
        made[id(lift)] = way
        return lift

    some = by_rims(Search(environment, reach, CollisionCheck(environment, reach), driver.state()), operator)
    return [made[id(each.operator)] for each in some], [each.operator for each in some]


@pytest.mark.slow
def test_both_hands_pinch_the_wall_on_their_own_side_and_lift_the_vessel(driver: Driver, robot: RobotModel) -> None:
    ways, operators = found(driver, robot)
    state: State = driver.state()
    base = state.objects["basket"]
    assert len(ways) > 3
    for way in ways:
        walls = {limb: grasp.wall for limb, grasp in way.grasps.items()}
        sides = {limb: transforms.apply(base, wall)[1] for limb, wall in walls.items() if wall is not None}
        assert sides["left"] > base[1, 3] > sides["right"], way.name
        for limb, grasp in way.grasps.items():
            hand = Reach(robot, limb).fingers
            tips = [hand.tip(role, grasp.open) for role in (hand.thumb, *hand.fingers) if role]
            radii = np.linalg.norm(transforms.apply(grasp.palm, np.array(tips))[:, :2], axis=1)
            assert radii.min() < RADIUS_M < radii.max(), f"{way.name}: no tip on either side of the wall"
    start = starts.photographed(driver.environment.bundle, driver.environment.model)
    episodes = [driver.run(each, start, origin="operator") for each in operators[:3]]
    assert any(episode.success for episode in episodes), [episode.reason for episode in episodes]
    pressing = {limb for limb, grasp in driver.environment.state().grasps.items() if grasp.presses[0]}
    assert pressing == {"left", "right"}


@pytest.mark.medium
def test_a_box_has_no_rim(robot: RobotModel) -> None:
    box = factories.box_asset(size=(0.158, 0.21, 0.06))
    bundle = openarm_tasks.bundle(robot, LiftGoal(height_m=0.1), {"box": box}, "box", limbs=("left", "right"))
    assert found(Driver(Environment(bundle)), robot) == ([], [])
