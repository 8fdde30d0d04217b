"""Which pixels are the support, which are something else, and what lies behind the holes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.artifacts.camera import Capture
from dextera_build.artifacts.object import Support
from dextera_build.geometry import cameras, regions, transforms

from .surface import plane_depth
from .synthesis import smooth_part

RIM_M = 0.01
"""So near to the outline of the support nothing is taken for a neighbour [m]."""
SAME_COLOUR = 30.0
"""Unmeasured pixels this near to the smooth colour of the support are support, of 255."""


@dataclass(frozen=True)
class Layers:
    """Masks and maps of one photograph, all (H, W)."""

    hole: np.ndarray  # bool, to be filled
    plane: np.ndarray  # float64, depth of the support's plane [m]; infinite above the horizon
    floor: np.ndarray  # (H, W, 2) float64, where the ray meets the support, world x and y [m]
    level: np.ndarray  # bool, measured to lie in the support's plane
    elsewhere: np.ndarray  # bool, measured to be something else
    behind: np.ndarray  # bool, the support lies here, seen or hidden


def split(capture: Capture, support: Support, hole: np.ndarray, tolerance: float) -> Layers:
    """Sort the pixels of a capture.

    Inside the outline of the points measured in the support's plane, everything hidden is support. Beyond it, as
    far out as half its extent, a hidden pixel goes with the nearest one there that is not hidden: with something else
    where something else was measured, or where the colour is another one (the support ends here), with the
    support otherwise (only its measurement ended).

    Args:
        capture: Photograph and depth.
        support: Plane and outline.
        hole: (H, W) what will be taken out.
        tolerance: Height over or under the plane that still is support [m].
    """
    depth, k = capture.depth.depth, capture.camera.matrix()
    plane = plane_depth(capture.camera, support.world_from_camera)
    finite = np.isfinite(plane)
    pose = support.world_from_camera
    floor = transforms.apply(pose, cameras.backproject(np.where(finite, plane, 0.0), k))[..., :2]
    height = transforms.apply(pose, cameras.backproject(depth, k))[..., 2]
    measured = (depth > 0) & ~hole
    reach = float(np.ptp(support.polygon, axis=0).max()) / 2
    around = finite & regions.inside_convex(floor, support.polygon, reach)
    level = measured & (np.abs(height) <= tolerance)
    elsewhere = measured & ~level
    seen = floor[_wide(level & around)]
    outline = regions.convex_hull(np.concatenate([support.polygon, seen[:: max(1, len(seen) // 20_000)]]))
    inside = finite & regions.inside_convex(floor, outline)
    outside = ~hole & ~regions.inside_convex(floor, outline, RIM_M)
    alike = outside & ~elsewhere & _coloured_like(capture.rgb.pixels, level & around)
    goes_on = around & _nearer(_wide(alike), outside & ~alike)
    return Layers(hole, plane, floor, level, elsewhere, np.asarray(~elsewhere & (inside | goes_on)))


def _wide(mask: np.ndarray) -> np.ndarray:
    """The mask without strips that are narrow in the picture: depth is missing along every edge."""
    side = max(3, mask.shape[1] // 40)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8)) > 0)


def _coloured_like(pixels: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Pixels that have about the colour that the support around them lets expect."""
    size = (max(1, level.shape[1] // 4), max(1, level.shape[0] // 4))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    known = cv2.resize(level.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    if known.sum() < 100:
        return np.ones_like(level)
    step = np.abs(cv2.blur(small, (3, 3)) - smooth_part(small, known, 8.0)).max(axis=-1)
    return np.asarray(cv2.resize(step, level.shape[::-1], interpolation=cv2.INTER_LINEAR) < SAME_COLOUR)


def _nearer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Where a pixel of `first` is nearer than one of `second`."""
    if not first.any() or not second.any():
        return np.full(first.shape, bool(first.any()))
    to_first, to_second = (cv2.distanceTransform((~m).astype(np.uint8), cv2.DIST_L2, 5) for m in (first, second))
    return np.asarray(to_first <= to_second)
