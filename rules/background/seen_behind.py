"""What further photographs show behind the objects of the first one: true depth and colours of hidden surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.further import Further
from dextera_build.artifacts.objects.object import Support
from dextera_build.geometry import cameras, planes, raycast, regions, transforms

from .behind import Behind
from .steps import steps

STRIDE = 2
"""Spacing of the vertices of a further photograph's surfaces [px]."""
STEP_M = 0.03
"""Depth difference above which surfaces are not joined [m]."""
RAISED_M, RAISED_SIGMAS = 0.004, 2.0
"""Height above the support at which something stands on it: [m], and in addition in standard deviations."""
BESIDE_M = 0.05
"""What stands on the support may project beyond its outline by this [m]."""
RIM = 0.015
"""Pixels this near to something on the support, as a fraction of the width, may be smeared or in its shadow."""
SAME_M = 0.01
"""Surfaces of two photographs this near are the same one [m]."""
MOST_GAIN = 2.0
"""Largest ratio of two photographs' exposures."""
LEAST_SAME = 500
"""Minimum number of pixels for a comparison of exposures."""


def seen_behind(
    photograph: Photograph, depth: np.ndarray, support: Support, hidden: np.ndarray, further: Sequence[Further]
) -> Behind:
    """What further photographs show of the empty scene.

    Args:
        photograph: The first photograph.
        depth: (H, W) its depth [m].
        support: The support.
        hidden: (H, W) pixels of objects and of the robot.
        further: Photographs with their poses; the earlier one is preferred.
    """
    pixels, found = np.zeros_like(photograph.rgb.pixels), np.zeros(depth.shape, np.float32)
    source = np.zeros(depth.shape, np.int32)
    for number, one in enumerate(further, start=1):
        shown, behind = _from(photograph, depth, support, hidden, one)
        fresh = (behind > 0) & (source == 0)
        pixels[fresh], found[fresh], source[fresh] = shown[fresh], behind[fresh], number
    return Behind(pixels, found, source)


def _from(
    photograph: Photograph, depth: np.ndarray, support: Support, hidden: np.ndarray, one: Further
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (H, W, 3) uint8 and depth (H, W) float32 [m] of the empty scene in one photograph; depth 0 if unknown."""
    assert one.pose is not None
    assert one.capture.measured is not None
    own, camera = one.capture.photograph, photograph.camera
    measured = one.capture.measured.depth.depth.astype(np.float64)
    free = _empty(measured, own, support.camera_pose.matrix @ one.pose.matrix, support)
    surface = _surface(np.where(free, measured, 0.0), own.camera.matrix(), one.pose.matrix)
    render = raycast.render([surface], camera.matrix(), np.eye(4), camera.height, camera.width)
    found = np.where(np.isfinite(render.depth), render.depth, 0.0)
    # A surface in front of what the first photograph shows is an error of a pose, or was moved.
    found[(depth > 0) & (found < depth - SAME_M)] = 0.0
    points = transforms.apply(transforms.invert(one.pose.matrix), cameras.backproject(found, camera.matrix()))
    row, column, inside = cameras.nearest_pixels(points, own.camera.matrix(), measured.shape)
    found[~(inside & free[row, column])] = 0.0
    at = cameras.project(np.where(found[..., None] > 0, points, 1.0).reshape(-1, 3), own.camera.matrix())
    at = at.astype(np.float32).reshape(*found.shape, 2)
    colours = cv2.remap(own.rgb.pixels, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    same = ~hidden & (found > 0) & (depth > 0) & (np.abs(found - depth) < SAME_M)
    gain = _gain(photograph.rgb.pixels[same], colours[same])
    return np.clip(np.round(colours * gain), 0, 255).astype(np.uint8), found.astype(np.float32)


def _empty(depth: np.ndarray, own: Photograph, pose: np.ndarray, support: Support) -> np.ndarray:
    """Measured pixels (H, W) of a photograph that show nothing that stands on the support, nor its rim."""
    points = transforms.apply(pose, cameras.backproject(depth, own.camera.matrix()))
    over = regions.inside_convex(points[..., :2], support.polygon, BESIDE_M)
    raised = points[..., 2] > RAISED_M + RAISED_SIGMAS * planes.depth_sigma(depth)
    things = ((depth > 0) & over & raised).astype(np.uint8)
    # Single noisy pixels are no things.
    things = cv2.morphologyEx(things, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    radius = max(2, round(RIM * depth.shape[1]))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray((depth > 0) & (cv2.dilate(things, disc) == 0))


def _surface(depth: np.ndarray, k: np.ndarray, pose: np.ndarray) -> raycast.Surface:
    """The measured surfaces of a photograph as triangles, in the frame of the first camera."""
    coarse = depth[::STRIDE, ::STRIDE]
    points = transforms.apply(pose, cameras.backproject(depth, k)[::STRIDE, ::STRIDE])
    right, below = steps(coarse, STEP_M)
    whole = ~(right[:-1] | right[1:] | below[:, :-1] | below[:, 1:])
    number = np.arange(coarse.size).reshape(coarse.shape)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]]
    a, b, c, d = (corner[whole] for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    return raycast.Surface(points.reshape(-1, 3), faces)


def _gain(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Gains (3,) that give colours (N, 3) of another photograph the exposure of the first one's."""
    if len(first) < LEAST_SAME:
        return np.ones(3)
    ratio = (np.median(first, axis=0) + 1.0) / (np.median(other, axis=0) + 1.0)
    return np.asarray(ratio.clip(1.0 / MOST_GAIN, MOST_GAIN))
