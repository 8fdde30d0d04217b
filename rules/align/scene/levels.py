"""A capture prepared for scene alignment: at two sizes, with a mask of usable pixels."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.geometry.scene_alignment import Level

SATURATED = 250
"""Channel value at and above which a pixel is saturated."""
EDGE = 0.05
"""Relative depth difference of neighbours above which they are on an edge, where sensors mix both sides."""


def levels(capture: Capture, ignored: np.ndarray, widths: tuple[int, ...], farthest_m: float) -> list[Level]:
    """The capture from coarse to fine.

    Colours are averaged, depths are picked: an average over two surfaces would create flying pixels.

    Args:
        capture: With depth.
        ignored: (H, W) pixels of the robot and of objects.
        widths: Widths [px], limited to the width of the picture.
        farthest_m: Greater depths are ignored [m].
    """
    import cv2
    from scipy.ndimage import maximum_filter, minimum_filter

    assert capture.measured is not None
    pixels, camera = capture.photograph.rgb.pixels, capture.photograph.camera
    depth = capture.measured.depth.depth.astype(np.float64)
    depth = np.where(np.isfinite(depth) & (depth < farthest_m), depth, 0.0)
    edge = maximum_filter(depth, 3) - minimum_filter(depth, 3) > EDGE * depth
    depth = np.where(edge, 0.0, depth)
    lost = ignored | (pixels >= SATURATED).any(axis=-1)
    made = []
    for width in widths:
        small = camera.scaled(min(1.0, width / camera.width))
        size = (small.width, small.height)
        rgb = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA) / 255.0
        row = ((np.arange(small.height) + 0.5) * camera.height / small.height).astype(int)
        column = ((np.arange(small.width) + 0.5) * camera.width / small.width).astype(int)
        picked = depth[np.ix_(row, column)]
        free = cv2.resize(lost.astype(np.float32), size, interpolation=cv2.INTER_AREA) < 0.01
        made.append(Level(rgb, picked, free & (picked > 0), small.matrix()))
    return made
