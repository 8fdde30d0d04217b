"""Candidate grasps: what they promise about hand and object."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import Grip, RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.control.hand import HandKinematics
from dextera_build.sim.experts.grasps import candidates
from tests.robots import robot_recipes

STEP = 5
"""Of so many candidates one is looked at; the numbers of directions, tilts and distances are no multiples of it."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("kuka_leap", tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def hand(robot: RobotModel) -> HandKinematics:
    return HandKinematics(robot, "arm")


def tube(radius: float, height: float) -> np.ndarray:
    """Points on the side of an upright cylinder."""
    random = np.random.default_rng(0)
    turn, up = random.uniform(0, 2 * np.pi, 600), random.uniform(0, height, 600)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), up], axis=1)


def can(radius: float, height: float) -> np.ndarray:
    """Points on side and lid of an upright cylinder."""
    lid = tube(1.0, height) * [radius, radius, 0.0] * np.sqrt(np.linspace(0, 1, 600))[:, None] + [0.0, 0.0, height]
    return np.concatenate([tube(radius, height), lid])


@pytest.mark.medium
def test_a_pinch_has_the_object_between_thumb_and_fingers(robot: RobotModel, hand: HandKinematics) -> None:
    found = list(candidates(can(0.04, 0.1), {"pinch": robot.limbs["arm"].grips["pinch"]}, hand))
    assert found
    for grasp in found[::STEP]:
        thumb = transforms.apply(grasp.palm, hand.tip("tip_thumb", grasp.open))
        fingers = transforms.apply(grasp.palm, hand.reach(grasp.open))
        radii = np.linalg.norm([thumb[:2], fingers[:2]], axis=1)
        assert (radii > 0.04 + robot.limbs["arm"].grips["pinch"].tip_radius_m).all(), grasp.name
        cosine = thumb[:2] @ fingers[:2] / np.prod(radii)
        assert cosine < -0.9, grasp.name
        assert 0.0 < thumb[2] < 0.12
        assert 0.0 < fingers[2] < 0.12


@pytest.mark.medium
def test_the_wall_of_a_vessel_is_pinched_from_inside_and_outside(robot: RobotModel, hand: HandKinematics) -> None:
    pinch = {"pinch": robot.limbs["arm"].grips["pinch"]}
    assert not [grasp for grasp in candidates(can(0.07, 0.06), pinch, hand) if "wall" in grasp.name]
    found = [grasp for grasp in candidates(tube(0.07, 0.06), pinch, hand) if "wall" in grasp.name]
    assert found
    for grasp in found[::STEP]:
        thumb = transforms.apply(grasp.palm, hand.tip("tip_thumb", grasp.open))
        fingers = transforms.apply(grasp.palm, hand.reach(grasp.open))
        inner, outer = sorted(np.linalg.norm([thumb[:2], fingers[:2]], axis=1))
        assert inner < 0.07 < outer, grasp.name


def test_nothing_wider_than_the_hand_is_pinched(robot: RobotModel, hand: HandKinematics) -> None:
    assert not list(candidates(can(0.15, 0.1), {"pinch": robot.limbs["arm"].grips["pinch"]}, hand))


@pytest.mark.medium
def test_a_wrap_lays_the_object_into_the_palm(robot: RobotModel, hand: HandKinematics) -> None:
    grip = robot.limbs["arm"].grips["wrap"]
    found = list(candidates(can(0.035, 0.19), {"wrap": grip}, hand))
    assert found
    for grasp in found:
        out = grasp.palm[:3, :3] @ np.array(grip.facing)
        surface = grasp.palm[:3, 3] + out * grip.surface_m
        assert out @ -grasp.palm[:3, 3] > 0, f"{grasp.name} faces away"
        assert (can(0.035, 0.19) - surface).min() > -0.3
        assert grasp.away @ out < 0, "it waits behind"


@pytest.mark.medium
def test_candidates_are_rotations(robot: RobotModel, hand: HandKinematics) -> None:
    for grasp in candidates(can(0.035, 0.15), robot.limbs["arm"].grips, hand):
        turn = grasp.palm[:3, :3]
        assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_grip_that_only_points_holds_nothing(robot: RobotModel, hand: HandKinematics) -> None:
    assert not list(candidates(can(0.035, 0.15), {"point": robot.limbs["arm"].grips["point"]}, hand))


@pytest.mark.medium
@pytest.mark.parametrize("radius", [0.01, 0.02])
def test_a_thumb_that_closes_is_no_jaw_however_little_it_moves(
    robot: RobotModel, hand: HandKinematics, radius: float
) -> None:
    found = list(candidates(can(radius, 0.1), {"pinch": robot.limbs["arm"].grips["pinch"]}, hand))
    assert found
    assert not [grasp.name for grasp in found if "straight" in grasp.name or any(grasp.aside_m)]


class Jaw:
    """A finger that turns by its joint [rad] about a point 0.1 m behind the tips, against one that never moves."""

    thumb = "tip_fixed"

    def posture(self, joints: dict[str, float]) -> np.ndarray:
        return np.array([joints["jaw"]])

    def pressing(self, opened: np.ndarray, closed: np.ndarray) -> tuple[str, ...]:
        return ("tip_jaw",)

    def tip(self, role: str, posture: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.0, 0.03])

    def reach(self, posture: np.ndarray, pressing: tuple[str, ...]) -> np.ndarray:
        return np.array([0.0, 0.1 * np.sin(posture[0]), 0.1 * np.cos(posture[0]) - 0.07])


@pytest.mark.medium
def test_a_jaw_waits_with_both_sides_clear_of_the_object() -> None:
    ahead = (0.0, 0.0, 1.0)
    grip = Grip(against="thumb", open={"jaw": 1.2}, closed={"jaw": 0.0}, facing=ahead, pointing=ahead)
    jaw = Jaw()
    found = list(candidates(can(0.02, 0.06), {"pinch": grip}, jaw))  # type: ignore[arg-type]
    straight = [each for each in found if "straight" in each.name]
    assert 2 * len(straight) == len(found) > 0
    for grasp in found[::STEP]:
        palm = transforms.rigid(grasp.palm[:3, :3], grasp.palm[:3, 3] + grasp.aside_m)
        sides = [transforms.apply(palm, tip) for tip in (jaw.tip("", grasp.open), jaw.reach(grasp.open, ()))]
        near, far = sorted(float(np.linalg.norm(side[:2])) for side in sides)
        assert near > 0.02 + 0.005, grasp.name
        assert far - near < 0.01, grasp.name
    for grasp in straight:
        if "tilt 0" in grasp.name:
            np.testing.assert_allclose(grasp.palm[:3, 2], [0, 0, -1], atol=1e-9)
