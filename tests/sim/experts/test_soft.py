"""Fingers that overpower the thumb press less."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.sim.experts import soft
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import hand_tasks
from tests.robots.robot_recipes import built

FULL = np.array([0.2, 0.3, 0.3, 0.3])
"""Of a thumb and three fingers."""


def test_two_fingers_with_their_whole_effort_press_with_half_of_it() -> None:
    beyond = np.array([[0.5, 0.05, 0.1, 0.1], [0.5, 0.4, -0.6, 0.2]])
    found = soft.eased(beyond, [[1], [2], [3]], FULL)
    np.testing.assert_allclose(found, [[0.5, 0.05, 0.1, 0.1], [0.5, 0.15, -0.15, 0.2]])


def test_one_finger_is_left_alone() -> None:
    beyond = np.array([[0.5, 0.29, 0.1, 0.1], [0.1, 0.1, 0.1, 0.2]])
    np.testing.assert_array_equal(soft.eased(beyond, [[1], [2], [3]], FULL), beyond)


@pytest.mark.slow
def test_joints_of_a_finger_are_those_below_the_palm(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    robot = built("openarm_revo1", tmp_path)
    environment = Environment(hand_tasks.lift_can(runner, robot, ["left"]))
    limb = robot.limbs["left"]
    index = next(role for role in limb.fingers if "index" in role)
    assert soft._driven(environment, index, limb.hand) == ["left_index_flexion"]
    assert limb.thumb
    assert sorted(soft._driven(environment, limb.thumb, limb.hand)) == ["left_thumb_flexion", "left_thumb_rotation"]
