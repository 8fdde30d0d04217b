"""Sharpness of a photograph, relative to others of the same capture or absolute."""

from __future__ import annotations

import numpy as np


def steepest(pixels: np.ndarray) -> np.ndarray:
    """(4,) steepness of the steepest edges of a picture (H, W, 3) uint8, across, down and along both diagonals.

    Relative to the picture's contrast, and separate by direction, because motion blur affects one direction only.
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
    """Fraction of the edges of a grey picture (H, W) left by a blur of 2.5 px: near 1 if it is already blurred."""
    import cv2

    sharp, soft = (_edges(cv2.GaussianBlur(grey, (0, 0), sigma)) for sigma in (1.0, 2.5))
    return soft / max(sharp, 1e-9)


def _edges(grey: np.ndarray) -> float:
    down, across = np.gradient(grey)
    return float(np.hypot(down, across).mean())
