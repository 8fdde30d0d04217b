"""Pictures that nothing can be found in: dark ones, and ones that were taken in motion or out of focus."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.errors import listing
from dextera_build.rule import Context

DARK = 50.0
"""Brightest 2 % of a dark picture, of 255; pictures of a lit room had 150 to 255."""
BLURRED = 0.42
"""Least sharpness, over directions, in comparison with the median of the capture. In three real captures pictures had
at least 0.54, and at most 0.40 after a blur of sigma 2 px or a motion by 9 px in any direction."""


def doubt_pictures(ctx: Context, pictures: Mapping[str, np.ndarray]) -> None:
    """Warn of dark and of blurred pictures (H, W, 3) uint8 by name."""
    dark = [name for name, pixels in pictures.items() if np.quantile(pixels, 0.98) < DARK]
    if dark:
        ctx.warn(f"{listing(dark)}: too dark to find a board in; light the scene, or expose longer")
    lit = {name: np.maximum(sharpness(pixels), 1e-6) for name, pixels in pictures.items() if name not in dark}
    if len(lit) < 3:
        return
    usual = np.median(list(lit.values()), axis=0)
    ratios = {name: float((value / usual).min()) for name, value in lit.items()}
    blurred = [f"{name} ({ratio:.0%})" for name, ratio in ratios.items() if ratio < BLURRED]
    if blurred:
        ctx.warn(
            f"blurred, with the sharpness of the capture's median as 100 %: {listing(blurred)}; wait until the robot "
            "rests, and check the focus"
        )


def sharpness(pixels: np.ndarray) -> np.ndarray:
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
    steepest = np.array([np.quantile(np.abs(step), 0.998) for step in steps])
    return np.asarray(steepest / max(high - low, 8.0))
