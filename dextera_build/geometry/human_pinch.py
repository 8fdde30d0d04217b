"""Postures of a human hand whose thumb meets a finger."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, human_hand, least_squares

PLACE_M = 1e-4
"""Standard deviation of the place of one tip against the other [m]."""
ANGLE_RAD = 0.5
"""Standard deviation of an angle from where the search begins [rad]."""
MOST_RAD = 0.2
"""Largest change of an angle in one round [rad]."""
BENT_DEG = ((10, 15, 30, 30), (0, 45, 50, 33))
"""Where thumb and finger begin."""
ROUNDS = 40


def pinching(finger: str, apart_m: float, hand: human_hand.Hand | None = None) -> np.ndarray:
    """Angles (5, 4) [rad] of an open hand whose thumb and `finger` are `apart_m` apart at their tips, within limits.

    Args:
        finger: One of `hands.FINGERS` but the thumb.
        apart_m: Distance [m].
        hand: A hand of another size.
    """
    own, place = hand or human_hand.Hand(), hands.FINGERS.index(finger)
    start = human_hand.open_angles()
    start[[0, place]] = np.deg2rad(BENT_DEG)
    lower, upper = np.moveaxis(np.deg2rad(human_hand.LIMITS_DEG), -1, 0)

    def between(angles: np.ndarray) -> np.ndarray:
        points, _ = own.joints(angles, "right")
        return np.asarray(points[..., hands.TIPS[place], :] - points[..., hands.TIPS[0], :])

    # Along the line at the beginning: of the distance alone, the tips would pass each other for ever.
    wanted = apart_m * between(start) / np.linalg.norm(between(start))

    def step(angles: np.ndarray, _: int) -> tuple[np.ndarray, np.ndarray]:
        moved = np.zeros((8, 5, 4))
        moved[:4, 0], moved[4:, place] = np.eye(4), np.eye(4)
        rows = (between(angles + 1e-6 * moved) - between(angles)).T / 1e-6
        normal = least_squares.normal(rows, wanted - between(angles), np.full(3, PLACE_M**-2))
        back = (start - angles)[[0, place]].ravel()
        found = np.clip((normal + least_squares.prior(np.full(8, ANGLE_RAD), back)).solved(), -MOST_RAD, MOST_RAD)
        there = angles.copy()
        there[[0, place]] += found.reshape(2, 4)
        return found, np.clip(there, lower, upper)

    *_, last = least_squares.gauss_newton(start, step, range(ROUNDS), still=1e-5)
    return np.asarray(last)
