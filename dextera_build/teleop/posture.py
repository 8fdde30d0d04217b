"""Joints of a hand from one number, for devices without tracked fingers: controllers, keyboards, gamepads."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, human_hand, quaternions

CLOSED_DEG = ((15, 13, 44, 27), (20, 76, 45, 30), (0, 64, 48, 32), (-11, 63, 51, 34), (-11, 63, 51, 34))
"""Angles (5, 4) of the closed hand, in the order of `human_hand.Hand.joints`, found by a search: the tips of index and
middle finger come to 12 mm from the thumb's, and that of the ring finger to 20 mm."""


def joints(wrists: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Poses (2, 25, 7) of the joints of a left and a right hand of usual size: position [m], quaternion x y z w.

    Fingers bend together, from the open hand to `CLOSED_DEG`; a person's grasps begin with the same first synergy.

    Args:
        wrists: (2, 7) poses of the wrists with WebXR's axes, in the same form.
        closed: (2,) from 0 (open) to 1 (closed).
    """
    start, end = human_hand.open_angles(), np.deg2rad(CLOSED_DEG)
    found = np.empty((2, len(hands.JOINTS), 7))
    for hand, side in enumerate(hands.SIDES):
        angles = start + float(np.clip(closed[hand], 0, 1)) * (end - start)
        places, turns = human_hand.Hand().joints(angles, side)
        wrist = wrists[hand, [6, 3, 4, 5]] / np.linalg.norm(wrists[hand, 3:7])
        found[hand, :, :3] = places @ quaternions.to_matrix(wrist).T + wrists[hand, :3]
        found[hand, :, 3:] = quaternions.multiply(wrist, quaternions.from_matrices(turns))[:, [1, 2, 3, 0]]
    return found


def lengths() -> np.ndarray:
    """Lengths (2, 5) of the fingers of these hands [m]."""
    points, _ = human_hand.Hand().joints(human_hand.open_angles(), hands.SIDES[0])
    return np.stack([hands.finger_lengths(points)] * 2)
