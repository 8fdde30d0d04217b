"""Where `dxb new task` puts a robot."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.sim.model import reach, task_places
from dextera_build.sim.model.forward import Kinematics
from tests import episodes

NEAR = {"one": np.array([0.1, 0.0, 0.0]), "other": np.array([0.2, 0.1, 0.0])}
FAR = {"one": np.array([-2.0, 0.0, 0.0]), "other": np.array([2.0, 0.1, 0.0])}


def test_a_robot_of_unknown_size_is_put_behind_all_objects() -> None:
    (place,) = task_places.found(None, NEAR)
    assert place.objects == ()
    assert place.at_m == pytest.approx((0.15, 0.1 + task_places.BEHIND_M, 0.0))


def test_objects_are_before_the_arm_at_a_distance_that_it_reaches_with_ease() -> None:
    robot = episodes.robot()
    (place,) = task_places.found(robot, NEAR)
    ball = reach.of_limb(robot, "arm")
    assert ball is not None
    # The base's x points to the camera, against the world's y, and its y along the world's x.
    joint = np.add(place.at_m[:2], [ball.centre_m[1], -ball.centre_m[0]])
    away = np.linalg.norm(joint - np.array([0.15, 0.05])) / ball.radius_m
    assert task_places.NEAREST - 1e-9 <= away <= task_places.FARTHEST + 1e-9


def test_objects_that_no_arm_reaches_from_one_place_have_a_place_each() -> None:
    places = task_places.found(episodes.robot(), FAR)
    assert [place.objects for place in places] == [("one",), ("other",)]
    assert places[1].at_m[0] - places[0].at_m[0] == pytest.approx(4.0)


def test_a_robot_whose_hand_is_high_above_its_base_stands_on_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = episodes.robot()
    ball = reach.of_limb(robot, "arm")
    assert ball is not None
    frame = Kinematics.frame

    def higher(self: Kinematics, name: str) -> np.ndarray:
        found = frame(self, name)
        found[2, 3] = ball.radius_m
        return found

    monkeypatch.setattr(Kinematics, "frame", higher)
    (place,) = task_places.found(robot, NEAR)
    assert place.at_m[2] == pytest.approx((task_places.ABOVE - 1.0) * ball.radius_m)
