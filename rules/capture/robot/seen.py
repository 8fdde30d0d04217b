"""Warnings about unusable pictures: dark, blurred by motion, or out of focus."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.errors import listing
from dextera_build.geometry.sharpness import steepest
from dextera_build.rule import Context

DARK = 50.0
"""Brightness below which the brightest 2 % of a picture are dark, of 255; pictures of a lit room had 150 to 255."""
BLURRED = 0.42
"""Smallest sharpness over all directions, relative to the median of the capture. In three real captures pictures had
at least 0.54, and at most 0.40 after a blur of sigma 2 px or a motion by 9 px in any direction."""


def doubt_pictures(ctx: Context, pictures: Mapping[str, np.ndarray]) -> None:
    """Warn of dark and of blurred pictures (H, W, 3) uint8 by name."""
    dark = [name for name, pixels in pictures.items() if np.quantile(pixels, 0.98) < DARK]
    if dark:
        ctx.warn(f"{listing(dark)}: too dark to find a board in; light the scene, or expose longer")
    lit = {name: np.maximum(steepest(pixels), 1e-6) for name, pixels in pictures.items() if name not in dark}
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
