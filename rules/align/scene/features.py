"""Features of a photograph, and of the same one as if the camera looked straight down onto its largest plane.

Descriptors of a table's texture differ between two views 40 degrees apart, because perspective shears it differently in
both. A rotation of the camera, which needs the plane only, removes this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.geometry import cameras, planes, transforms

from ..matches import matches_sift
from ..matches.matches_sift import Points

CONTRAST = 0.015
"""Contrast of a keypoint, as a fraction of the range of brightness. Tables have little: with 0.04, two
to ten times fewer points agreed on drawn photographs 20 and 40 degrees apart."""
PIXEL_M = 0.0015
"""Length on the plane of a pixel of the levelled picture [m]."""
MOST_PX = 1600
"""Largest side of that picture [px]."""
SAMPLE = 6000
"""Number of points in which the plane is sought."""


@dataclass(frozen=True)
class Features:
    """Points of a photograph."""

    plain: Points
    level: Points
    """Those of the levelled picture, at their places in the photograph."""


def features_of(capture: Capture, most: int) -> Features:
    """SIFT keypoints of a photograph with depth, at most about so many of either kind."""
    plain = matches_sift.points_of(capture.photograph.rgb, most, CONTRAST)
    level = _levelled(capture, most)
    return Features(plain, Points(plain.pixels[:0], plain.descriptors[:0]) if level is None else level)


def paired(first: Features, second: Features, ratio: float) -> Matches:
    """Mutually nearest pairs of either kind that pass the ratio test."""
    kinds = [matches_sift.paired(getattr(first, kind), getattr(second, kind), ratio) for kind in ("plain", "level")]
    return Matches(
        **{
            name: np.concatenate([getattr(found, name) for found in kinds])
            for name in ("first", "second", "confidence")
        },
        method="SIFT",
    )


def _levelled(capture: Capture, most: int) -> Points | None:
    """The keypoints of the levelled picture; None without a large plane."""
    import cv2

    found = _homography(capture)
    if found is None:
        return None
    homography, size = found
    flat = cv2.warpPerspective(capture.photograph.rgb.pixels, homography, size, flags=cv2.INTER_LINEAR)
    points = matches_sift.points_of(Image(pixels=flat), most, CONTRAST)
    if not len(points.pixels):
        return None
    back = np.column_stack([points.pixels, np.ones(len(points.pixels))]) @ np.linalg.inv(homography).T
    pixels = back[:, :2] / back[:, 2:]
    rows, columns = capture.photograph.rgb.pixels.shape[:2]
    # Keypoints at the border of the photograph are its corners in the levelled picture.
    inside = (pixels > 8).all(axis=1) & (pixels[:, 0] < columns - 9) & (pixels[:, 1] < rows - 9)
    return Points(pixels[inside], points.descriptors[inside])


def _homography(capture: Capture) -> tuple[np.ndarray, tuple[int, int]] | None:
    """Photograph to levelled picture (3, 3), and the latter's width and height [px]."""
    assert capture.measured is not None
    depth = capture.measured.depth.depth.astype(np.float64)
    k = capture.photograph.camera.matrix()
    points = cameras.backproject(depth, k)[depth > 0]
    points = points[:: max(1, len(points) // SAMPLE)]
    found = planes.largest(points, planes.depth_sigma(points[:, 2]), np.random.default_rng(0))
    if found is None:
        return None
    normal, offset = planes.facing(found[0])
    down = transforms.rotation_between(-normal, np.array([0.0, 0.0, 1.0]))
    scale = abs(offset) / (k[0, 0] * PIXEL_M)
    turned = np.diag([scale, scale, 1.0]) @ k @ down @ np.linalg.inv(k)
    on = points[found[1]] @ down.T
    at = np.quantile(scale * cameras.project(on, k), [0.01, 0.99], axis=0)
    width, height = np.ceil(at[1] - at[0]).astype(int).clip(1, MOST_PX)
    shift = np.array([[1.0, 0.0, -at[0, 0]], [0.0, 1.0, -at[0, 1]], [0.0, 0.0, 1.0]])
    return shift @ turned, (int(width), int(height))
