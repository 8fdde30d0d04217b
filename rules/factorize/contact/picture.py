"""A picture of convex pieces in distinct colours."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.geometry import convex, raycast, transforms

_SIZE = 320
_LIGHT = np.array([0.4, -0.5, 0.77])


def draw(hulls: Sequence[Hull]) -> np.ndarray:
    """Draw the pieces from 40 degrees above, assembled and exploded; (H, W, 3) uint8."""
    middle = np.concatenate([hull.vertices for hull in hulls]).mean(axis=0, dtype=np.float64)
    apart = [0.35 * (hull.vertices.mean(axis=0, dtype=np.float64) - middle) for hull in hulls]
    together = [np.zeros(3)] * len(hulls)
    return np.concatenate([_view(hulls, moved) for moved in (together, apart)], axis=1)


def _view(hulls: Sequence[Hull], moved: Sequence[np.ndarray]) -> np.ndarray:
    surfaces = [_surface(hull, shift, number) for number, (hull, shift) in enumerate(zip(hulls, moved, strict=True))]
    points = np.concatenate([surface.vertices for surface in surfaces])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    k = np.array([[2.0 * _SIZE, 0, _SIZE / 2], [0, 2.0 * _SIZE, _SIZE / 2], [0, 0, 1.0]])
    seen = raycast.render(surfaces, k, _look_at(middle, 4.3 * radius), _SIZE, _SIZE)
    shade = 0.45 + 0.55 * np.abs(seen.normal @ _LIGHT)
    pixels = np.full((_SIZE, _SIZE, 3), 255, np.uint8)
    hit = seen.index >= 0
    pixels[hit] = (raycast.shade(surfaces, seen)[hit] * shade[hit][:, None]).astype(np.uint8)
    return pixels


def _surface(hull: Hull, shift: np.ndarray, number: int) -> raycast.Surface:
    vertices, faces = convex.surface(hull.vertices)
    # Golden-angle steps give consecutive pieces distinct hues.
    colour = colorsys.hsv_to_rgb(0.618034 * number % 1.0, 0.55, 0.95)
    return raycast.Surface(vertices + shift, faces, colour=colour)


def _look_at(target: np.ndarray, distance: float) -> np.ndarray:
    """T_world_camera of a camera that looks at `target` from the front right, above."""
    back = np.array([0.45, -0.62, 0.64])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return transforms.rigid(np.stack([right, -np.cross(back, right), -back], axis=1), target + distance * back)
