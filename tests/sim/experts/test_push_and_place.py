"""The scripts of `push` and `pick_and_place`, done by an iiwa with a LEAP Hand on a plain table."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.goals import Goal
from dextera_build.sim.experts.candidates import Search, experts
from dextera_build.sim.experts.collision_check import CollisionCheck
from dextera_build.sim.experts.drive import Driver
from dextera_build.sim.experts.grasps import candidates
from dextera_build.sim.experts.reach import Reach
from dextera_build.sim.primitives.pick_and_place.primitive import PlaceGoal
from dextera_build.sim.primitives.pick_and_place.script import Place
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.primitives.push.primitive import PushGoal
from dextera_build.sim.primitives.push.script import Push, Slide
from dextera_build.sim.runtime import starts
from dextera_build.sim.runtime.environment import Environment
from tests import factories, openarm_tasks
from tests.robots import robot_recipes

NEAR = Tolerance(position_m=0.03, rotation_rad=0.26)
BASE = factories.pose(-0.55, 0.0, 0.0)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("kuka_leap", tmp_path_factory.mktemp("robot"))


def driver(robot: RobotModel, goal: Goal) -> Driver:
    box = factories.box_asset(factories.pose(0.0, 0.05), size=(0.06, 0.06, 0.10), mass=0.2)
    bundle = openarm_tasks.bundle(robot, goal, {"box": box}, "box", base=BASE, timeout_s=12.0)
    return Driver(Environment(bundle))


@pytest.mark.medium
def test_a_push_ends_with_the_object_at_its_target_and_begins_behind_it(robot: RobotModel) -> None:
    made = driver(robot, PushGoal(place_m=(0.1, 0.0), yaw_rad=None, upright=(1, 0, 0, 0), tolerance=NEAR))
    legs = Push(made.environment, Reach(robot, "arm"), Slide(0.0, 0.0)).legs(made.state())
    way = legs[-1].palm[:3, 3] - legs[2].palm[:3, 3]
    assert way == pytest.approx([0.1, -0.05, 0.0], abs=1e-6)
    assert (legs[2].palm[:3, 3] - legs[1].palm[:3, 3]) @ way > 0
    steps = np.array([leg.palm[:3, 3] for leg in legs[2:]])
    assert np.linalg.norm(np.diff(steps, axis=0), axis=1).max() < 0.15 / 20


def test_a_push_that_did_not_arrive_is_done_again_from_above(robot: RobotModel) -> None:
    made = driver(robot, PushGoal(place_m=(0.1, 0.0), yaw_rad=None, upright=(1, 0, 0, 0), tolerance=NEAR))
    operator, state = Push(made.environment, Reach(robot, "arm"), Slide(0.0, 0.0)), made.state()
    operator.begin(state)
    steps = sum(round(leg.seconds * made.environment.task.control_hz) for leg in operator.legs(state))
    segments, palms = [], []
    for _ in range(2 * steps):
        command = operator.command(state)
        assert command is not None
        segments.append(command.segment)
        palms.append(command.aims["arm"].palm[:3, 3])
    again = segments.index("approach", steps)
    assert set(segments[steps:again]) == {"push"}
    back = palms[again - 1] - palms[steps - 1]
    assert back @ np.array([0.1, -0.05, 0.0]) < 0
    assert "push" in segments[again:]


@pytest.mark.slow
def test_plans_are_made_with_the_robot_where_it_is_believed_to_stand(robot: RobotModel) -> None:
    made = driver(robot, PushGoal(place_m=(0.1, 0.0), yaw_rad=None, upright=(1, 0, 0, 0), tolerance=NEAR))
    environment, reach, found = made.environment, Reach(robot, "arm"), []
    (expert,) = experts("push")
    (first, *_) = expert.plan(Search(environment, reach, CollisionCheck(environment, reach), made.state()))
    # The second base is so low that the hand would be in the table.
    for low in (0.0, -0.2):
        environment.begin(environment.start.model_copy(update={"base_error": (0.0, 0.0, low, 0.0, 0.0, 0.0)}))
        found.append(first.operator.comfort(CollisionCheck(environment, reach), made.state()))
    assert found[0] is not None
    assert found[0] == found[1]


@pytest.mark.slow
def test_fingertips_push_a_box_to_its_target(robot: RobotModel) -> None:
    made = driver(robot, PushGoal(place_m=(0.1, 0.0), yaw_rad=None, upright=(1, 0, 0, 0), tolerance=NEAR))
    reach = Reach(robot, "arm")
    (expert,) = experts("push")
    found = expert.plan(Search(made.environment, reach, CollisionCheck(made.environment, reach), made.state()))
    start = starts.photographed(made.environment.bundle, made.environment.model)
    episodes = [made.run(each.operator, start, origin="operator") for each in found[:8]]
    # A rehearsal keeps the best of them.
    assert sum(episode.success for episode in episodes) >= 2, [episode.reason for episode in episodes]


@pytest.mark.slow
def test_a_box_is_carried_and_set_down(robot: RobotModel) -> None:
    made = driver(robot, PlaceGoal(place_m=(0.05, -0.18, 0.0), tolerance=NEAR))
    environment, reach = made.environment, Reach(robot, "arm")
    room, state = CollisionCheck(environment, reach), made.state()
    grasps = list(candidates(environment.bundle.objects["box"].points.astype(np.float64), reach.grips, reach.fingers))
    drawn = np.random.default_rng(0).permutation(len(grasps))
    places = (Place(environment, reach, grasps[number]) for number in drawn)
    free = (each for each in places if room.comfort(each.phases(state), state) is not None)
    start = starts.photographed(environment.bundle, environment.model)
    episodes = [made.run(next(free), start, origin="operator") for _ in range(12)]
    # A rehearsal keeps the best of them.
    assert sum(episode.success for episode in episodes) >= 4, [episode.reason for episode in episodes]
    done = next(episode for episode in episodes if episode.success)
    assert [segment.name for segment in done.segments][-3:] == ["lower", "release", "retreat"]
