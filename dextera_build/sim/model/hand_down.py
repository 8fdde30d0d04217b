"""How far from an arm an object stands, so that the hand goes from it straight up."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from dextera_build.geometry import lie
from dextera_build.sim.model.forward import Kinematics

LOOKED, MIDDLE, HEIGHTS_M = (0.2, 0.6), 0.4, (0.05, 0.2)
"""Distances that are looked at, and the one in the middle, in lengths of the arm; heights of the palm above the table,
at an object and raised [m]."""
MISSED_M, FREE_RAD, ROOM_RAD = 0.003, 0.35, 1e-3
"""Largest error of a pose that an arm reaches; distance of joints from their limits, above which more is no better;
distance of the first guess from them."""


def distance(
    kinematics: Kinematics, limb: str, joint: np.ndarray, length: float, angle: float, height: float
) -> float | None:
    """Horizontal distance [m] from an arm's first joint at which its hand, which points down, goes from an object up.

    Of those that it reaches, one at which no joint is near a limit, and neither folded nor stretched; None if there is
    none. Contacts are not looked at.

    Args:
        kinematics: The robot, which is at home before and after.
        limb: Name of the limb.
        joint: Position (3,) of its first joint in the base frame [m].
        length: Length of the stretched arm with its hand [m].
        angle: Direction from that joint to the object, about z of the base [rad].
        height: Height of the base above the table [m].
    """
    home, names = kinematics.robot.home, kinematics.robot.limbs[limb].arm
    joints = {each.name: each for each in kinematics.robot.joints}
    low, high = (np.array([getattr(joints[name], end) for name in names]) for end in ("lower", "upper"))
    palm = kinematics.frame(kinematics.robot.limbs[limb].palm)
    down = int(np.argmin(palm[2, :3]))
    turn = _level(palm[:3, :3], down)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    beside = palm[:3, 3] - joint
    beside = (beside - (beside @ along) * along) * [1.0, 1.0, 0.0]

    def missed(posture: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        kinematics.pose(dict(zip(names, posture.tolist(), strict=True)))
        now = kinematics.frame(kinematics.robot.limbs[limb].palm)
        # A turn by one radian counts as 0.3 m.
        return np.concatenate([now[:3, 3] - wanted, 0.3 * lie.rotation_vector(now[:3, :3] @ turn.T)])

    found: dict[float, float] = {}
    seed = np.clip([home[name] for name in names], low + ROOM_RAD, high - ROOM_RAD)
    for far in np.linspace(*LOOKED, 9) * length:
        room = FREE_RAD
        for up in HEIGHTS_M:
            wanted = np.append((joint + far * along + beside)[:2], up - height)
            solved = optimize.least_squares(missed, seed, bounds=(low, high), args=(wanted,), max_nfev=40)
            if float(np.abs(solved.fun).max()) > MISSED_M:
                break
            room = min(room, float(np.minimum(solved.x - low, high - solved.x).min()))
        else:
            found[float(far)] = room - abs(far / length - MIDDLE)
    kinematics.pose({})
    return max(found, key=found.__getitem__) if found else None


def _level(turn: np.ndarray, down: int) -> np.ndarray:
    """The rotation (3, 3) next to `turn` of which column `down` points straight down."""
    axis, straight = turn[:, down], np.array([0.0, 0.0, -1.0])
    across = np.cross(axis, straight)
    angle = float(np.arctan2(np.linalg.norm(across), axis @ straight))
    return np.asarray(lie.rotation(across / max(float(np.linalg.norm(across)), 1e-9) * angle) @ turn)
