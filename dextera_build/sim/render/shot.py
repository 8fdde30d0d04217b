"""An ideal picture, and its averaging from finer ones; needs no renderer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAMMA = 2.2
"""Exponent that approximates the sRGB curve when light is averaged."""


@dataclass(frozen=True)
class Shot:
    """The picture of an ideal camera."""

    rgb: np.ndarray  # (H, W, 3) float64, sRGB 0..1
    depth: np.ndarray  # (H, W) float64, image-plane z [m]; 0 if empty
    labels: np.ndarray  # (H, W) int32, object label at the pixel's centre; 0 for everything else


def average(pixels: np.ndarray, factor: int) -> np.ndarray:
    """Mean of `factor` x `factor` blocks of sRGB bytes in linear light, (H, W, 3) float64 sRGB 0..1."""
    linear = ((np.arange(256) / 255.0) ** GAMMA)[pixels]
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    blocks = linear.reshape(height, factor, width, factor, 3).mean(axis=(1, 3))
    return np.asarray(blocks ** (1 / GAMMA))
