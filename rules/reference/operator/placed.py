"""Where a human hand is when a robot's hand is there: axes, sizes, fingers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import hands, human_hand, poses, quaternions
from dextera_build.geometry.human_hand import Hand
from dextera_build.rule import Context

from . import fitted

NAMES = {"little": "pinky"}
"""Finger's name in roles of robots -> in WebXR."""
_MIDDLE = human_hand.BASE_ALONG + human_hand.KNUCKLE_ALONG[1] / 2


class Grip(NamedTuple):
    """What is needed of a robot's hand."""

    turn: np.ndarray
    """(3, 3) rotation from the axes of a human wrist to those of the robot's palm."""
    open: dict[str, float]
    """Joint -> position of the open hand [rad]."""
    fingers: tuple[int, ...]
    """Human finger of each tip of the robot, the thumb's first."""
    order: tuple[int, ...]
    """Number of each of these tips among the limb's."""


def grip_of(ctx: Context, robot: RobotModel, limb: str) -> Grip:
    """Directions and fingers of a limb's hand."""
    parts = robot.limbs[limb]
    grip = next(iter(parts.grips.values()), None)
    if grip is None or not parts.palm or parts.thumb is None or len(parts.tips) < 2:
        ctx.fail(
            f"limb `{limb}` has no hand that a human hand could lead",
            tips=", ".join(parts.tips) or "none",
            grips=", ".join(parts.grips) or "none",
            hint="describe a palm, a thumb, a finger and a grip of the robot",
        )
    back, ahead = -np.array(grip.facing), np.array(grip.pointing)
    turn = np.stack([np.cross(back, -ahead), back, -ahead], axis=1)
    named = {}
    for number, role in enumerate(parts.tips):
        name = role.rpartition("tip_")[2]
        free = next((finger for finger in range(1, 5) if finger not in named), 4)
        finger = 0 if role == parts.thumb else _finger(NAMES.get(name, name), free)
        named[finger] = number
    fingers = tuple(sorted(named))
    return Grip(turn, dict(grip.open), fingers, tuple(named[finger] for finger in fingers))


def middle(hand: Hand) -> np.ndarray:
    """The point (3,) of the human hand that lies where the robot's palm is: half way along the third metacarpal [m]."""
    return np.array([0.0, 0.0, -_MIDDLE * hand.length_m])


def scale(hand: Hand, grip: Grip, tips: np.ndarray) -> float:
    """Size of the human hand relative to the robot's: reach of the open fingers beyond the palm.

    Args:
        hand: The human hand.
        grip: The robot's.
        tips: (F, 3) of the open robot's hand in the palm's frame [m].
    """
    lengths = np.linalg.norm(tips[list(grip.order[1:])], axis=1)
    open_tips = fitted.tips(hand, human_hand.open_angles()[None])[0, list(grip.fingers[1:])]
    return float(np.median(np.linalg.norm(open_tips - middle(hand), axis=1) / lengths))


def targets(hand: Hand, grip: Grip, tips: np.ndarray, factor: float, *, side: int) -> np.ndarray:
    """Places (T, F, 3) of the human tips in the frame of the wrist of a right hand [m].

    Args:
        hand: The human hand.
        grip: The robot's.
        tips: (T, F, 3) of the robot in the palm's frame [m].
        factor: Size of the human hand relative to the robot's.
        side: 0 for a left hand, whose places are mirrored.
    """
    found = middle(hand) + factor * tips[:, list(grip.order)] @ grip.turn
    return found if side else hands.mirrored(found)


def wrists(hand: Hand, grip: Grip, palms: np.ndarray) -> np.ndarray:
    """Poses (T, 7) of the human wrist where the robot's palm is at poses (T, 7)."""
    found = []
    for palm in palms:
        matrix = poses.to_matrix(palm)
        turn = matrix[:3, :3] @ grip.turn
        found.append(np.append(matrix[:3, 3] - turn @ middle(hand), quaternions.from_matrix(turn)))
    return np.array(found)


def _finger(name: str, free: int) -> int:
    return hands.FINGERS.index(name) if name in hands.FINGERS else free
