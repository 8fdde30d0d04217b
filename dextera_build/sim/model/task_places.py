"""Places at which a robot is put for the objects of a twin, before anybody measured where it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import lie
from dextera_build.sim.model import hand_down, reach
from dextera_build.sim.model.forward import Kinematics

BEHIND_M = 0.55
"""Distance at which a robot of unknown size is put behind the objects [m]."""
NEAREST, FARTHEST = 0.35, 0.5
"""Distance of an object from an arm's first joint, in lengths of the stretched arm with its hand: outside of it an arm
is folded, or has no freedom to turn its hand."""
EDGE = 0.6
"""Distance up to which an arm is taken to do a task, in the same lengths."""
RAISED, ABOVE = 0.45, 0.25
"""Height of a palm at home above which a robot stands on the floor, and that above the table to which it is put then,
in the same lengths."""


TO_CAMERA_DEG = 270.0
"""Direction from the objects' far side to the camera, about z of the twin's world [deg]."""


@dataclass(frozen=True)
class Place:
    """Where the base is put, so that the arm faces the camera."""

    at_m: tuple[float, float, float]
    """Position in the twin's world [m]."""
    objects: tuple[str, ...]
    """Labels of the objects that it is for; empty: all."""
    yaw_deg: float = TO_CAMERA_DEG
    """Rotation of the base about z [deg]."""


@dataclass(frozen=True)
class _Arms:
    """What is needed of a robot, in its base frame, turned so that its arms point along x [m]."""

    joints: np.ndarray
    """First joints (L, 2) of the arms."""
    lengths: np.ndarray
    """Lengths (L,) of the stretched arms, with their hands."""
    ahead: float
    """Distance along x at which an object is put."""
    height: float
    """Height of the base above the support."""
    turn_deg: float
    """Rotation of the base about z that makes the arms point along x [deg]."""


def found(robot: RobotModel | None, objects: Mapping[str, np.ndarray]) -> list[Place]:
    """One place for all objects, or one for each if an arm does not reach all of them from one place.

    Args:
        robot: The robot; None: its size is unknown.
        objects: Label -> position (3,) in the twin's world [m].
    """
    spots = np.array(list(objects.values()))
    arms = None if robot is None else _arms(robot)
    if arms is None:
        far = (float(spots[:, 0].mean()), float(spots[:, 1].max()) + BEHIND_M, 0.0)
        return [Place(far, ())]
    yaw = (TO_CAMERA_DEG + arms.turn_deg) % 360.0
    middle = (spots[:, :2].min(axis=0) + spots[:, :2].max(axis=0)) / 2
    one = _before(arms, middle)
    if all(_reaches(arms, one, spot[:2]) for spot in spots):
        return [Place(one, (), yaw)]
    return [Place(_before(arms, spot[:2]), (label,), yaw) for label, spot in objects.items()]


def _before(arms: _Arms, spot: np.ndarray) -> tuple[float, float, float]:
    """Position of the base from which a spot (2,) is ahead, in the middle of the arms."""
    side = float(arms.joints[:, 1].mean())
    return (float(spot[0]) - side, float(spot[1]) + arms.ahead, arms.height)


def _reaches(arms: _Arms, base: Sequence[float], spot: np.ndarray) -> bool:
    # The arms' x is the world's -y, and their y the world's x.
    joints = np.array(base[:2]) + np.stack([arms.joints[:, 1], -arms.joints[:, 0]], axis=1)
    away = np.linalg.norm(joints - spot, axis=1)
    return bool((away <= EDGE * arms.lengths).any())


def _arms(robot: RobotModel) -> _Arms | None:
    """The arms of a robot that have a palm; None if there are none."""
    limbs = [name for name, limb in robot.limbs.items() if limb.arm and limb.palm]
    balls = [ball for name in limbs if (ball := reach.of_limb(robot, name)) is not None]
    if not balls:
        return None
    kinematics = Kinematics(robot)
    kinematics.pose({})
    palms = np.array([kinematics.frame(robot.limbs[name].palm)[:3, 3] for name in limbs])
    joints, lengths = np.array([ball.centre_m for ball in balls]), np.array([ball.radius_m for ball in balls])
    length = float(lengths.min())
    # One arm may point anywhere from its base; of several, the base's x is the front.
    x, y = (palms - joints).mean(axis=0)[:2]
    angle = float(np.arctan2(y, x)) if len(balls) == 1 and np.hypot(x, y) > NEAREST * length / 2 else 0.0
    turned = joints @ lie.rotation(np.array([0.0, 0.0, -angle])).T
    up = float(palms[:, 2].mean())
    height = ABOVE * length - up if up > RAISED * length else 0.0
    away = hand_down.distance(kinematics, limbs[0], joints[0], length, angle, height)
    if away is None:
        far = float(np.hypot(x, y)) if angle else float(x)
        away = float(np.clip(far, NEAREST * length, FARTHEST * length))
    return _Arms(turned[:, :2], lengths, float(turned[:, 0].mean()) + away, height, -float(np.degrees(angle)))
