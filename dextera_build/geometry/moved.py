"""Test whether a camera has moved relative to a robot since its calibration, from new pictures of the same board.

Without motion, the board in each new picture is at its pose predicted by calibration and robot, up to errors of the
size of the calibration's residuals. A larger common displacement is a motion of the camera, of the robot's base, or of
the board on its holder; pictures of the board cannot distinguish these.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from dextera_build.geometry import hand_eye, lie

SURE = 1e-3
"""Significance level at which a displacement is a motion."""
DOUBTFUL = 0.05
"""Significance level above which there is no motion, if a notable motion would have been detected."""


@dataclass(frozen=True)
class Verdict:
    """Result of the test."""

    state: Literal["unmoved", "moved", "unsure"]
    chance: float  # of a displacement as large as the observed one without motion
    motion: np.ndarray  # (4, 4) of the board in the camera's frame, about the board: seen = motion @ expected
    shift_m: float  # its length at the board
    turn_rad: float  # its rotation
    sigma_m: float  # standard deviation of the shift's length, along each axis
    sigma_rad: float  # the same of the rotation


def judge(
    expected: np.ndarray, seen: np.ndarray, residuals: np.ndarray, notable: tuple[float, float] = (0.005, 0.009)
) -> Verdict:
    """Compare predicted and measured poses T_camera_board (N, 4, 4).

    Args:
        expected: Predicted by the calibration and the robot's poses.
        seen: Measured in the pictures.
        residuals: (K, 2) of the calibration's own pictures: translation [m] and rotation [rad], K > 2.
        notable: Relevant motion [m, rad]; if the errors could hide it, the answer is `unsure`.
    """
    from scipy.stats import f

    shifts = seen[:, :3, 3] - expected[:, :3, 3]
    turns = np.array([lie.rotation_vector(s[:3, :3] @ e[:3, :3].T) for e, s in zip(expected, seen, strict=True)])
    shift, turn = shifts.mean(axis=0), turns.mean(axis=0)
    count, rows = len(expected), len(residuals)
    # Twelve numbers were fitted to six residuals per picture, so the errors are larger than the residuals by this
    # factor.
    left = max(6 * rows - 12, 6) / (6 * rows)
    of_one = np.sqrt((residuals**2).mean(axis=0) / 3 / left)  # along each axis
    sigma = of_one * np.sqrt(1 / count + 1 / rows)
    freedom = max(3 * rows - 6, 1)
    chances = [
        float(f.sf(float(found @ found) / 3 / max(one**2, 1e-18), 3, freedom))
        for found, one in ((shift, sigma[0]), (turn, sigma[1]))
    ]
    chance = min(1.0, 2 * min(chances))
    blind = (3 * sigma > notable).any()
    state: Literal["unmoved", "moved", "unsure"] = "unsure"
    if chance < SURE:
        state = "moved"
    elif chance >= DOUBTFUL and not blind:
        state = "unmoved"
    middle = hand_eye.mean_pose(list(expected))[:3, 3]
    motion = lie.motion(np.append(shift, turn), middle)
    return Verdict(
        state,
        chance,
        motion,
        float(np.linalg.norm(shift)),
        float(np.linalg.norm(turn)),
        float(sigma[0]),
        float(sigma[1]),
    )
