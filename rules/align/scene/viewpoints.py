"""Viewpoints for rendering a generated scene, to match a photograph taken far from its own picture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.geometry.lie import rotation

TURNS_DEG = (20.0, 40.0)
"""Horizontal angles about the centre of the visible scene, to each side [deg]."""
RISES_DEG = (15.0,)
"""Vertical angles about it [deg]."""
NEARER, FARTHER = 0.65, 1.5
"""Distances from the centre, relative to that of the picture."""


def around(taken: np.ndarray, depth: float) -> Iterator[np.ndarray]:
    """T_G_C (4, 4) of cameras around the camera `taken` (4, 4): rotated about the point at `depth`, then nearer.

    Args:
        taken: T_G_C of the picture that the scene was made from.
        depth: Median depth of the scene there, in its unit.
    """
    sides = [(0.0, sign * angle) for angle in TURNS_DEG for sign in (1, -1)]
    rises = [(sign * angle, 0.0) for angle in RISES_DEG for sign in (1, -1)]
    for pitch, yaw in (*sides, *rises):
        yield taken @ _about(depth, pitch, yaw)
    for factor in (NEARER, FARTHER):
        yield taken @ transforms.rigid(np.eye(3), np.array([0.0, 0.0, (1 - factor) * depth]))
    for sign in (1, -1):  # a pan: the camera rotates in place and looks next to the visible scene
        yield taken @ transforms.rigid(rotation(np.array([0.0, sign * np.radians(TURNS_DEG[0]), 0.0])), np.zeros(3))


def _about(depth: float, pitch_deg: float, yaw_deg: float) -> np.ndarray:
    """T_taken_C of a camera rotated about the point at `depth` in front of the original camera."""
    turn = rotation(np.radians([pitch_deg, 0.0, 0.0])) @ rotation(np.radians([0.0, yaw_deg, 0.0]))
    middle = np.array([0.0, 0.0, depth])
    return transforms.rigid(turn, middle - turn @ middle)
