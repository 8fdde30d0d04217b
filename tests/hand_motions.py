"""Motions of an articulated human hand that opens, closes and pinches; a program made them, no person took part."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_pinch import pinching

SECONDS = 0.6
"""Time from one posture to the next; half as long at rest there."""
PINCH_M = 0.010
"""Distance of the tips of a pinch."""


def fist() -> np.ndarray:
    """Angles (5, 4) [rad] of a loosely closed hand."""
    return np.deg2rad([[20, 20, 40, 40], *[[0, 60, 70, 47]] * 4])


def keys() -> list[tuple[str, np.ndarray]]:
    """Postures in order."""
    opened = ("open", human_hand.open_angles())
    pinches = [(finger, pinching(finger, PINCH_M)) for finger in hands.FINGERS[1:]]
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
