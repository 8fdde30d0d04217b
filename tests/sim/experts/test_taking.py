"""What a script does after its grasp: it goes on with the object in the hand, and only then."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.operator import NotHeld, State
from dextera_build.sim.experts.candidates import Search, experts, grips
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.grasp import Grasp
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.experts.reachable import Reachable
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.pick_and_place.script import Place
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks
from tests.robots import robot_recipes

TARGET_M = (0.0, 0.05, 0.009)
"""Place of the upper bowl in the lower one."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def stacking(robot: RobotModel) -> Driver:
    """One bowl is to be put into another."""
    goal = PlaceGoal(place_m=TARGET_M, quaternion=None, tolerance=Tolerance(position_m=0.03, rotation_rad=0.35))
    bowls = {
        "upper": factories.bowl_asset(factories.pose(0.0, -0.15), radius=0.055, height=0.065, mass=0.2),
        "lower": factories.bowl_asset(factories.pose(*TARGET_M[:2]), radius=0.070, height=0.065),
    }
    return Driver(Environment(openarm_tasks.bundle(robot, goal, bowls, "upper")))


@pytest.fixture(scope="module")
def by_the_wall(stacking: Driver, robot: RobotModel) -> Grasp:
    return next(each for each in grips(stacking.environment, Reach(robot, "right")) if "tripod wall" in each.name)


@pytest.fixture
def placing(stacking: Driver, robot: RobotModel, by_the_wall: Grasp) -> Place:
    return Place(stacking.environment, Reach(robot, "right"), by_the_wall)


def carried(state: State, name: str, by: np.ndarray) -> State:
    """The state with the object where `by` (4, 4) in the base takes it."""
    return State(state.joints, {**state.objects, name: by @ state.objects[name]}, state.displacement)


@pytest.mark.medium
@pytest.mark.parametrize("came_along", [True, False])
def test_the_plan_goes_on_only_with_the_object_in_the_hand(stacking: Driver, placing: Place, came_along: bool) -> None:
    state, grasp = stacking.state(), placing.grasp
    placing._plan = placing.taking(state)
    placing._start, placing._commands = state.objects["upper"], iter(())
    last = placing._plan["right"][-1].palm
    by = last @ transforms.invert(state.objects["upper"] @ grasp.palm)
    if came_along:
        command = placing.command(carried(state, "upper", by))
        assert command is not None
        assert command.segment == "carry"
    else:
        with pytest.raises(NotHeld, match=r"the grasp failed: the object is \d+ mm from where the hand would hold it"):
            placing.command(state)


def test_fingertips_stay_clear_of_the_bowl_in_which_another_is_put(stacking: Driver, placing: Place) -> None:
    state, grasp = stacking.state(), placing.grasp
    legs = placing.phases(state)[1]["right"]
    lowered = next(leg.palm for leg in legs if leg.segment == "lower")
    above = lowered @ transforms.invert(grasp.palm)
    planned = stacking.environment.bundle.base_pose.inverse().matrix @ [*TARGET_M, 1.0]
    assert 0.0 < above[2, 3] - planned[2] < 0.06
    assert above[:2, 3] == pytest.approx(planned[:2], abs=1e-6)
    bowl = transforms.apply(
        state.objects["lower"], stacking.environment.bundle.objects["lower"].points.astype(np.float64)
    )
    hand = Reach(stacking.environment.bundle.robot, "right").fingers
    tips = transforms.apply(lowered, np.array([hand.tip(role, grasp.closed) for role in hand.roles]))
    assert np.linalg.norm(bowl[:, None] - tips, axis=2).min() > 0.02


@pytest.mark.slow
def test_a_bowl_is_taken_by_its_rim_and_put_into_another(stacking: Driver, robot: RobotModel) -> None:
    environment, reach = stacking.environment, Reach(robot, "right")
    search = Search(environment, reach, CollisionCheck(environment, reach), stacking.state(), enough=12)
    start = starts.photographed(environment.bundle, environment.model)
    episodes = [
        stacking.run(each.operator, start, origin="operator") for each in experts("pick_and_place")[0].plan(search)
    ]
    # A rehearsal keeps the best of them.
    assert any(episode.success for episode in episodes), [episode.reason for episode in episodes]


def test_poses_that_an_arm_reaches_are_nearer_than_others(robot: RobotModel) -> None:
    arm = Reach(robot, "left").arm
    home, behind, turned = arm.pose(arm.home), arm.pose(arm.home), arm.pose(arm.home)
    behind[0, 3] -= 0.8
    turned[:3, :3] = turned[:3, :3] @ np.diag([-1.0, 1.0, -1.0])
    near, far, over = Reachable(arm).away_m(np.array([home, behind, turned]))
    assert near < 0.08
    assert far > 4 * near
    assert over > 2 * near
