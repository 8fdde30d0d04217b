"""Motions of an articulated human hand that opens, closes and pinches; a program made them, no person took part."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import least_squares

from dextera_build.geometry import hands, human_hand

SECONDS = 0.6
"""Time from one posture to the next; half as long at rest there."""
PINCH_M = 0.010
"""Distance of the tips of a pinch."""


@cache
def pinching(finger: str, apart_m: float = PINCH_M) -> np.ndarray:
    """Angles (5, 4) [rad] of a hand whose thumb and `finger` are `apart_m` from each other, within its limits."""
    place = hands.FINGERS.index(finger)
    start = human_hand.open_angles()
    lower, upper = np.deg2rad(human_hand.LIMITS_DEG[..., 0]), np.deg2rad(human_hand.LIMITS_DEG[..., 1])
    free = np.zeros((5, 4), bool)
    free[0], free[place] = True, True
    guess = start.copy()
    guess[0], guess[place] = np.deg2rad([10, 15, 30, 30]), np.deg2rad([0, 45, 50, 33])

    def off(angles: np.ndarray) -> np.ndarray:
        whole = start.copy()
        whole[free] = angles
        points, _ = human_hand.Hand().joints(whole, "right")
        bent = 0.002 * (whole - guess)[free]
        coupled = 0.01 * (whole[place, 3] - human_hand.COUPLED * whole[place, 2])
        return np.array([hands.pinch_distance(points, finger) - apart_m, coupled, *bent])

    inside = np.clip(guess[free], lower[free], upper[free])
    found = start.copy()
    found[free] = least_squares(off, inside, bounds=(lower[free] - 1e-9, upper[free] + 1e-9), xtol=1e-12).x
    return found


def fist() -> np.ndarray:
    """Angles (5, 4) [rad] of a loosely closed hand."""
    return np.deg2rad([[20, 20, 40, 40], *[[0, 60, 70, 47]] * 4])


def keys() -> list[tuple[str, np.ndarray]]:
    """Postures in order."""
    opened = ("open", human_hand.open_angles())
    pinches = [(finger, pinching(finger)) for finger in hands.FINGERS[1:]]
    return [opened, ("fist", fist()), opened, *(each for pinch in pinches for each in (pinch, opened))]


def motion(
    rate_hz: float = 72.0, side: str = "right", noise_m: float = 0.0, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stamps (N,) [s], joints (N, 25, 3) [m] in the wrist's frame, and at rest the name of the posture of each message.

    Args:
        rate_hz: Messages per second.
        side: "left" or "right".
        noise_m: Standard deviation of every coordinate of every joint [m].
        seed: Of the noise.
    """
    postures = keys()
    count = int(1.5 * SECONDS * len(postures) * rate_hz)
    stamps = np.arange(count) / rate_hz
    phase = stamps / (1.5 * SECONDS)
    place = np.minimum(phase.astype(int), len(postures) - 1)
    share = np.clip((phase - place - 1 / 3) * 1.5, 0.0, 1.0)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    angles = np.array([angle for _, angle in postures])
    after = np.minimum(place + 1, len(postures) - 1)
    bent = angles[place] + share[:, None, None] * (angles[after] - angles[place])
    points, _ = human_hand.Hand().joints(bent, side)
    noise = noise_m * np.random.default_rng(seed).normal(size=points.shape)
    resting = phase - place < 1 / 3
    return stamps, points + noise, [postures[p][0] if still else "" for p, still in zip(place, resting, strict=True)]
