"""How sharp a photograph is, beside others of the same capture or by itself."""

from __future__ import annotations

import numpy as np


def steepest(pixels: np.ndarray) -> np.ndarray:
    """(4,) how steep the steepest edges of a picture (H, W, 3) uint8 are, across, down and along both diagonals.

    Relative to the picture's contrast, and apart by direction, because motion blurs one direction only.
    """
    grey = pixels.mean(axis=2, dtype=np.float32)
    low, high = np.quantile(grey, (0.02, 0.98))
    steps = (
        grey[:, 1:] - grey[:, :-1],
        grey[1:] - grey[:-1],
        (grey[1:, 1:] - grey[:-1, :-1]) / np.sqrt(2.0),
        (grey[1:, :-1] - grey[:-1, 1:]) / np.sqrt(2.0),
    )
    found = np.array([np.quantile(np.abs(step), 0.998) for step in steps])
    return np.asarray(found / max(high - low, 8.0))


def left_by_blur(grey: np.ndarray) -> float:
    """Part of the edges of a grey picture (H, W) that a blur of 2.5 px leaves: near 1 if it is blurred already."""
    import cv2

    sharp, soft = (_edges(cv2.GaussianBlur(grey, (0, 0), sigma)) for sigma in (1.0, 2.5))
    return soft / max(sharp, 1e-9)


def _edges(grey: np.ndarray) -> float:
    down, across = np.gradient(grey)
    return float(np.hypot(down, across).mean())
