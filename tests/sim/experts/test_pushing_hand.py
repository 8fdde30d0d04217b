"""The fingertips of a pushing hand, and those that take part in a grip."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.sim.experts.pushing import SUPPORT_M, WIDTH, Pushed
from dextera_build.sim.experts.reach import Reach
from tests.robots import robot_recipes

UP = np.array([0.0, 0.0, 1.0])
WAY = np.array([0.6, 0.8, 0.0])


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotModel:
    return robot_recipes.built("openarm_revo1", tmp_path_factory.mktemp("robot"))


@pytest.mark.parametrize("pitch", [0.0, 0.7, -1.2])
@pytest.mark.parametrize("lean", [0.0, 0.5, -0.9])
def test_the_lowest_fingertip_clears_the_support_and_the_foremost_touches(
    robot: RobotModel, pitch: float, lean: float
) -> None:
    reach = Reach(robot, "right")
    hand = Pushed(reach)
    turn = hand.turn(WAY, np.cos(pitch) * UP + np.sin(pitch) * np.cross(UP, WAY), lean)
    palm = hand.palm(turn, UP * hand.height(turn, UP) - WAY * hand.ahead(turn, WAY))
    tips = np.array([reach.fingers.tip(role, hand.fingers) for role in reach.fingers.fingers])
    placed = tips @ palm[:3, :3].T + palm[:3, 3]
    assert (placed @ UP).min() - hand.tip_m == pytest.approx(SUPPORT_M)
    assert (placed @ WAY).max() + hand.tip_m == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("slant", [0.0, 0.6, -0.6])
def test_a_push_begins_where_the_first_fingertip_meets_the_side(robot: RobotModel, slant: float) -> None:
    reach = Reach(robot, "right")
    hand = Pushed(reach)
    turn = hand.turn(WAY, UP, 0.0)
    across = np.cross(UP, WAY)
    steps = np.linspace(-0.15, 0.15, 301)[:, None]
    wall = 0.07 * WAY + steps * (np.cos(slant) * across + np.sin(slant) * WAY)
    palm = hand.palm(turn, WAY * hand.meets(turn, WAY, UP, wall))
    tips = np.array([reach.fingers.tip(role, hand.fingers) for role in reach.fingers.fingers])
    placed = tips @ palm[:3, :3].T + palm[:3, 3]
    gaps = [
        (wall[np.abs((wall - tip) @ across) < WIDTH * hand.tip_m] @ WAY).min() - tip @ WAY - hand.tip_m
        for tip in placed
    ]
    assert min(gaps) == pytest.approx(0.0, abs=1e-9)
    if slant == 0.0:
        assert hand.meets(turn, WAY, UP, wall) == pytest.approx(0.07 - hand.ahead(turn, WAY))


def test_fingers_that_stay_straight_do_not_press(robot: RobotModel) -> None:
    reach = Reach(robot, "left")
    hand, grip = reach.fingers, reach.grips["tripod"]
    opened, closed = hand.posture(grip.open), hand.posture({**grip.open, **grip.closed})
    pressing = hand.pressing(opened, closed)
    assert pressing == ("left_tip_index", "left_tip_middle")
    # The thumb meets the middle of both, so that a thin object does not turn as they close.
    meeting = opened + 0.9 * (closed - opened)
    assert hand.thumb is not None
    offset = hand.tip(hand.thumb, meeting) - hand.reach(meeting, pressing)
    assert abs(offset[1]) < 0.004
    assert abs((hand.tip(hand.thumb, meeting) - hand.reach(meeting))[1]) > 0.012
    assert hand.pressing(opened, opened) == hand.fingers
