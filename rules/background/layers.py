"""Which pixels are the support, which are something else, and what lies behind the holes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from dextera_build.artifacts.camera import Capture
from dextera_build.artifacts.object import Support
from dextera_build.geometry import cameras, regions, transforms

from .surface import plane_depth


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

    Inside the seen outline of the support everything hidden is support. Around it, hidden and unmeasured pixels go
    with the nearest pixel that was measured, as far out as half the outline's extent.

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
    inside = finite & regions.inside_convex(floor, support.polygon)
    around = finite & regions.inside_convex(floor, support.polygon, reach)
    level = measured & (np.abs(height) <= tolerance)
    elsewhere = measured & ~level
    behind = ~elsewhere & (inside | (around & _nearer(level & around, elsewhere)))
    return Layers(hole, plane, floor, level, elsewhere, np.asarray(behind))


def _nearer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Where a pixel of `first` is nearer than one of `second`."""
    if not first.any() or not second.any():
        return np.full(first.shape, bool(first.any()))
    to_first, to_second = (cv2.distanceTransform((~m).astype(np.uint8), cv2.DIST_L2, 5) for m in (first, second))
    return np.asarray(to_first <= to_second)
