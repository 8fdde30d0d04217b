"""Steps of a depth map between different surfaces."""

from __future__ import annotations

import cv2
import numpy as np

BASE = 3
"""Number of pixels over which the slope on either side of a possible step is estimated."""


def smoothed(depth: np.ndarray) -> np.ndarray:
    """Depth (H, W) float32 without noise but with its steps; 0 is kept."""
    known = depth > 0
    if not known.any():
        return depth.astype(np.float32)
    # The filter would average unmeasured pixels: a very large depth is outside its range.
    filled = np.where(known, depth, 4.0 * float(depth.max())).astype(np.float32)
    soft = cv2.bilateralFilter(filled, 7, 0.03, 2.5)
    return np.where(known, soft, 0.0).astype(np.float32)


def steps(depth: np.ndarray, step_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of neighbours on surfaces more than `step_m` apart.

    A plane is linear in inverse depth, so each side is extrapolated by its own slope to the other, and a surface at a
    grazing angle is no step.

    Args:
        depth: (H, W) [m]; 0 if unknown.
        step_m: Distance along the viewing direction [m].

    Returns:
        (H, W - 1) bool for pixels and their right neighbours, (H - 1, W) bool for pixels and those below. Pairs with
        an unknown depth are steps.
    """
    return _along(depth, step_m), _along(depth.T, step_m).T


def _along(depth: np.ndarray, step_m: float) -> np.ndarray:
    inverse = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-6), np.nan)
    left, right = inverse[:, :-1], inverse[:, 1:]
    metres = np.fmin(depth[:, :-1], depth[:, 1:]) ** 2
    apart = np.abs(left - right)
    slope = np.full_like(inverse, np.nan)
    slope[:, BASE:] = (inverse[:, BASE:] - inverse[:, :-BASE]) / BASE
    onwards = np.abs(left + slope[:, :-1] - right)
    slope[:] = np.nan
    slope[:, :-BASE] = (inverse[:, BASE:] - inverse[:, :-BASE]) / BASE
    back = np.abs(right - slope[:, 1:] - left)
    least = np.fmin(np.fmin(onwards, back), apart) * metres
    return np.asarray(~(least <= step_m))
