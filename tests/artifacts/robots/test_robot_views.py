"""RobotViews: a row stays with its picture, in whatever order they are given and however often they are stored."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.joints import Joints
from tests.rules.align.calibration import boards


def views(names: list[str]) -> RobotViews:
    """A grey picture of brightness n with the rows n, for each name `rgb_n`."""
    numbers = np.array([float(name.split("_")[1]) for name in names])
    captures = {
        name: boards.capture(np.full((480, 640, 3), number, np.uint8))
        for name, number in zip(names, numbers, strict=True)
    }
    effectors = np.zeros((len(names), 7))
    effectors[:, 0], effectors[:, 3] = numbers, 1.0
    joints = Joints(names=("a",), stamps=numbers, positions=numbers[:, None])
    return RobotViews(captures=captures, mount="eye_on_base", effectors=effectors, joints=joints, skew_s=numbers)


def test_rows_follow_their_pictures() -> None:
    found = views(["rgb_9", "rgb_10", "rgb_11", "rgb_2"])
    assert list(found.captures) == sorted(found.captures)
    assert found.effectors is not None
    assert found.joints is not None
    assert found.skew_s is not None
    for row, capture in enumerate(found.captures.values()):
        number = float(capture.photograph.rgb.pixels[0, 0, 0])
        assert found.effectors[row, 0] == found.joints.positions[row, 0] == found.joints.stamps[row] == number
        assert found.skew_s[row] == number
