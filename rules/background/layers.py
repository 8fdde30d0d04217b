"""Classification of pixels as support or other surfaces, and of the surfaces behind holes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Support
from dextera_build.geometry import cameras, regions, transforms

from .surface import plane_depth
from .synthesis import smooth_part

RIM_M = 0.01
"""Pixels closer than this to the support's outline do not count as neighbours [m]."""
SAME_COLOUR = 30.0
"""Colour distance from the smooth support below which unmeasured pixels are support, of 255."""
FARTHEST = 2.0
"""Reach of the support's continuation behind removed pixels where no other surface is, relative to that elsewhere."""
GROWTH = 4
"""How often this continuation is compared with the colours of what was found of it."""


@dataclass(frozen=True)
class Layers:
    """Masks and maps of one photograph, all (H, W)."""

    hole: np.ndarray  # bool, to be filled
    plane: np.ndarray  # float64, depth of the support's plane [m]; infinite above the horizon
    floor: np.ndarray  # (H, W, 2) float64, intersection of the ray with the support, world x and y [m]
    level: np.ndarray  # bool, measured in the support's plane
    elsewhere: np.ndarray  # bool, measured off the support
    behind: np.ndarray  # bool, support, visible or hidden
    beyond: np.ndarray  # bool, hidden pixels at which the support goes on if no other surface does


def split(photograph: Photograph, depth: np.ndarray, support: Support, hole: np.ndarray, tolerance: float) -> Layers:
    """Classify the pixels of a capture.

    Inside the outline of the points measured in the support's plane, hidden pixels are support. Beyond it, up to half
    its extent, a hidden pixel takes the class of the nearest visible one: another surface if measured as such or of
    a different colour (the support ends here), otherwise support (only its measurement ends). A hidden pixel of no
    other surface is support, too, where visible pixels of gradually changing colours show that it goes on.

    Args:
        photograph: The picture.
        depth: (H, W) [m], 0 where nothing was measured.
        support: Plane and outline.
        hole: (H, W) pixels to be removed.
        tolerance: Maximum distance of the support's pixels from the plane [m].
    """
    k = photograph.camera.matrix()
    plane = plane_depth(photograph.camera, support.camera_pose.matrix)
    finite = np.isfinite(plane)
    pose = support.camera_pose.matrix
    floor = transforms.apply(pose, cameras.backproject(np.where(finite, plane, 0.0), k))[..., :2]
    height = transforms.apply(pose, cameras.backproject(depth, k))[..., 2]
    measured = (depth > 0) & ~hole
    reach = float(np.ptp(support.polygon, axis=0).max()) / 2
    around = finite & regions.inside_convex(floor, support.polygon, reach)
    level = measured & (np.abs(height) <= tolerance)
    elsewhere = measured & ~level
    seen = floor[_wide(level & around)]
    outline = _outline(np.concatenate([support.polygon, seen[:: max(1, len(seen) // 20_000)]]))
    inside = finite & regions.inside_convex(floor, outline)
    outside = ~hole & ~regions.inside_convex(floor, outline, RIM_M)
    alike = outside & ~elsewhere & coloured_like(photograph.rgb.pixels, level & around)
    goes_on = around & _nearer(_wide(alike), outside & ~alike)
    behind = np.asarray(~elsewhere & (inside | goes_on))
    far = finite & regions.inside_convex(floor, support.polygon, FARTHEST * reach)
    alike = _wide(outside & _joined(photograph.rgb.pixels, level & around, far & ~elsewhere & ~hole))
    points = np.concatenate([outline, floor[alike][:: max(1, int(alike.sum()) // 20_000)]])
    beyond = hole & far & (_nearer(alike, outside & ~alike) | regions.inside_convex(floor, _outline(points)))
    # A hole beside which nothing of the continuation is visible tells of none.
    beyond &= _reached(hole, alike)
    # Where another surface was measured nearby, the support is seen to end.
    beyond &= _nearer(level, _wide(elsewhere))
    return Layers(hole, plane, floor, level, elsewhere, behind, np.asarray(beyond))


def _joined(pixels: np.ndarray, level: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Pixels (H, W) of `free` that continue the support beyond its measured part `level` (H, W).

    Its light changes with the distance, so its continuation is compared with the colours of what was found of it.
    """
    found = free & coloured_like(pixels, level)
    for _ in range(GROWTH):
        _, labels = cv2.connectedComponents((level | found).astype(np.uint8), connectivity=4)
        near = np.zeros(int(labels.max()) + 1, bool)
        near[labels[level]] = True
        found |= free & coloured_like(pixels, level | (found & near[labels]))
    return np.asarray(found)


def apart(layers: Layers, own: np.ndarray) -> Layers:
    """The layers without surfaces that are level with the support and continue it beyond its edge, as a robot's plate.

    A region of another colour is one if most of it is outside the convex outline of the pixels `own` (H, W) that have
    the support's colours; inside, it is a sheet that lies on the support.
    """
    seen = layers.floor[_wide(layers.level & layers.behind & own & ~layers.hole)]
    if len(seen) < 100:
        return layers
    outline = _outline(seen[:: max(1, len(seen) // 20_000)])
    _, labels = cv2.connectedComponents((layers.behind & ~own & ~layers.hole).astype(np.uint8), connectivity=4)
    inside = np.isfinite(layers.plane) & regions.inside_convex(layers.floor, outline)
    within = np.bincount(labels[inside], minlength=labels.max() + 1) / np.maximum(np.bincount(labels.reshape(-1)), 1)
    beyond = within < 0.5
    beyond[0] = False
    other = beyond[labels]
    return replace(
        layers,
        level=layers.level & ~other,
        elsewhere=layers.elsewhere | (other & layers.level),
        behind=layers.behind & ~other,
    )


def _outline(points: np.ndarray) -> np.ndarray:
    """Convex outline (P, 2) of points (N, 2), simplified to a millimetre, which is less than their noise [m].

    Every corner costs a pass over the picture.
    """
    outline = regions.convex_hull(points)
    return np.asarray(cv2.approxPolyDP(outline.astype(np.float32)[:, None], 0.001, True)[:, 0], np.float64)


def _wide(mask: np.ndarray) -> np.ndarray:
    """The mask without strips narrow in the image: depth is missing along every edge."""
    side = _side(mask.shape[1])
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8)) > 0)


def _side(width: int) -> int:
    """Width below which a strip is narrow [px]."""
    return max(3, width // 40)


def coloured_like(pixels: np.ndarray, level: np.ndarray, most: float = SAME_COLOUR) -> np.ndarray:
    """Pixels with about the colour of the surrounding support; at most `most` of 255 apart."""
    small = _small(pixels)
    known = cv2.resize(level.astype(np.uint8), small.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    if known.sum() < 100:
        return np.ones_like(level)
    step = np.abs(cv2.blur(small, (3, 3)) - smooth_part(small, known, 8.0)).max(axis=-1)
    return np.asarray(cv2.resize(step, level.shape[::-1], interpolation=cv2.INTER_LINEAR) < most)


def plain_colour(pixels: np.ndarray, level: np.ndarray) -> np.ndarray | None:
    """The support's own smooth colour, (H / 4, W / 4, 3) float32; None if hardly anything of it was measured.

    Papers that lie flat on the support are measured as a part of it. They are excluded, unless they cover most of it.
    """
    small = _small(pixels)
    known = cv2.resize(level.astype(np.uint8), small.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0
    if known.sum() < 100:
        return None
    soft = cv2.blur(small, (3, 3))
    plain = np.broadcast_to(np.median(small[known], axis=0), small.shape)
    for most in (2 * SAME_COLOUR, SAME_COLOUR, SAME_COLOUR):
        alike = known & (np.abs(soft - plain).max(axis=-1) < most)
        if alike.sum() < 0.5 * known.sum():
            return smooth_part(small, known, 8.0)
        plain = smooth_part(small, alike, 8.0)
    return np.asarray(plain)


def _small(pixels: np.ndarray) -> np.ndarray:
    size = (max(1, pixels.shape[1] // 4), max(1, pixels.shape[0] // 4))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.float32)


def _reached(mask: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The parts (H, W) of a mask next to which there is some of `other`."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    kept = np.zeros(int(labels.max()) + 1, bool)
    kept[labels[grown(other, _side(mask.shape[1]))]] = True
    return np.asarray(mask & kept[labels])


def grown(mask: np.ndarray, reach: int) -> np.ndarray:
    """The mask (H, W) bool with all pixels within `reach` rows and columns of it."""
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square) > 0)


def _nearer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Pixels nearer to `first` than to `second`."""
    if not first.any() or not second.any():
        return np.full(first.shape, bool(first.any()))
    to_first, to_second = (cv2.distanceTransform((~m).astype(np.uint8), cv2.DIST_L2, 5) for m in (first, second))
    return np.asarray(to_first <= to_second)
