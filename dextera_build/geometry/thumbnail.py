"""Small pictures of meshes from points on their surface: fast, without a renderer."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dextera_build.geometry.cameras import look_at

_SAMPLES = 300_000
_SIZE = (240, 320)
"""Rows and columns [px]."""
_PAPER = 255


Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Faces (N,) and barycentric weights (N, 3) of points -> their sRGB (N, 3), 0..1."""


def thumbnail(parts: Sequence[tuple[np.ndarray, Paint]], around: np.ndarray | None = None) -> np.ndarray:
    """Meshes from their front left and above, (240, 320, 3) uint8 on white.

    Args:
        parts: Corners (F, 3, 3) of the faces of each mesh, z up, and a function that colours its points.
        around: Points (N, 3) to which the view is fitted, so that pictures of moving parts can be compared; None: the
            meshes.
    """
    picture = np.full((*_SIZE, 3), _PAPER, np.uint8)
    whole = np.concatenate([np.zeros((0, 3)), *(corners.reshape(-1, 3) for corners, _ in parts)])
    areas = [_cross(corners) for corners, _ in parts]
    total = sum(float(np.linalg.norm(cross, axis=1).sum()) for cross in areas)
    if not total > 0:
        return picture
    pose, middle, reach = _viewpoint(whole if around is None else around)
    seen = [
        _points(corners, cross, paint, pose, total)
        for (corners, paint), cross in zip(parts, areas, strict=True)
        if len(corners)
    ]
    places, colours = (np.concatenate(found) for found in zip(*seen, strict=True))
    return _dotted(picture, (places - middle @ pose[:3, :3]) / reach, colours, 2)


def scatter(points: np.ndarray, colours: np.ndarray) -> np.ndarray:
    """Points from their front left and above, (240, 320, 3) uint8 on white.

    Args:
        points: (N, 3), z up; at most 300,000 are drawn, evenly sampled.
        colours: (N, 3) sRGB, 0..1.
    """
    picture = np.full((*_SIZE, 3), _PAPER, np.uint8)
    chosen = slice(None, None, -(-len(points) // _SAMPLES) or 1)
    points, colours = points[chosen].astype(np.float64), colours[chosen]
    if not len(points):
        return picture
    pose, middle, reach = _viewpoint(points)
    wide = 3 if len(points) < 3_000 else 2 if len(points) < 30_000 else 1
    return _dotted(picture, (points - middle) @ pose[:3, :3] / max(reach, 1e-12), colours, wide)


def _viewpoint(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """T_world_camera (4, 4), the centre (3,) of the points (N, 3), and their extent from it across the view."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    pose = look_at(middle + np.array([-0.6, -0.8, 0.55]), middle)
    return pose, middle, float(np.linalg.norm((points - middle) @ pose[:3, :2], axis=1).max())


def _dotted(picture: np.ndarray, places: np.ndarray, colours: np.ndarray, wide: int) -> np.ndarray:
    """The picture with squares of `wide` pixels at (N, 3): right, down and forward, within 1 of the centre."""
    order = np.argsort(-places[:, 2], kind="stable")  # the nearest point is written last
    scaled = places[order, :2] * (0.48 * min(_SIZE))
    column, row = (np.round(scaled[:, axis] + _SIZE[1 - axis] / 2).astype(int) for axis in (0, 1))
    shades = np.round(255 * colours[order].clip(0, 1)).astype(np.uint8)
    offsets = np.arange(wide) - wide // 2
    rows, columns = row[:, None, None] + offsets[:, None], column[:, None, None] + offsets
    picture[rows, columns] = shades[:, None, None]
    return picture


def _cross(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float64)


def _points(
    corners: np.ndarray, cross: np.ndarray, paint: Paint, pose: np.ndarray, total: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points of one mesh along the axes of the camera, and their shaded colours."""
    area = np.linalg.norm(cross, axis=1)
    count = max(int(_SAMPLES * area.sum() / total), 1)
    face = np.searchsorted(np.cumsum(area), (np.arange(count) + 0.5) / count * area.sum()).clip(0, len(area) - 1)
    # Deterministic sampling, so that the picture of a value never changes.
    weight = np.random.default_rng(0).dirichlet(np.ones(3), count)
    points = (corners[face] * weight[..., None]).sum(axis=1) @ pose[:3, :3]
    facing = np.abs(cross[face] @ pose[:3, 2]) / np.maximum(area[face], 1e-18)
    return points, paint(face, weight) * (0.5 + 0.5 * facing[:, None])
