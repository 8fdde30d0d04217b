"""The transfer function of sRGB (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np


def to_linear(shades: np.ndarray) -> np.ndarray:
    """Linear light 0..1 of sRGB values 0..1, of any shape."""
    return np.where(shades <= 0.04045, shades / 12.92, ((shades + 0.055) / 1.055) ** 2.4)


def to_srgb(light: np.ndarray) -> np.ndarray:
    """SRGB values 0..1 of linear light, of any shape; light outside 0..1 is clipped."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
