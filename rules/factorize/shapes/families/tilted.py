"""A box in any orientation: leaning, or on an uneven surface."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, planes, solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M

DEEP = 0.4
"""Minimum depth of a start along the line of sight, as a fraction of the median size: cartons are flat."""
LEAST_PART = 0.15
"""Smallest fraction of the points on a face that defines a direction."""
LEAST_FACE = 50
"""Minimum number of points on a second face."""
ASIDE = 0.35
"""Largest cosine between the normals of two faces that are perpendicular."""


def tilted(evidence: Evidence) -> tuple[list[np.ndarray], Model] | None:
    """Initial orientations (3, 3), and the model: index of one, a further rotation vector, centre, sizes; or None.

    Each start fixes the first parameter, the index of its initial orientation.
    """
    frames = _frames(evidence)
    if not frames:
        return None
    starts = []
    for number, frame in enumerate(frames):
        turned = evidence.points @ frame
        low, high = np.quantile(turned, 0.01, axis=0), np.quantile(turned, 0.99, axis=0)
        low, high = deepened(low, high, frame.T @ (np.median(evidence.points, axis=0) - evidence.eye), DEEP)
        starts.append(np.array([number, 0.0, 0.0, 0.0, *(frame @ (low + high) / 2), *(high - low)]))
    inf = np.inf
    model = Model(
        name="tilted_box",
        build=lambda p: tilted_body(p).moved(tilted_pose(frames, p)),
        starts=starts,
        steps=np.array([1e-9, 0.015, 0.015, 0.015, 0.003, 0.003, 0.003, 0.003, 0.003, 0.003]),
        lower=np.array([-inf] * 7 + [SMALLEST_M] * 3),
        upper=np.array([inf] * 7 + [LARGEST_M] * 3),
        expected=np.array([0.0] * 7 + [float(np.median(starts[0][7:]))] * 3),
        spread=np.array([inf] * 7 + [0.1] * 3),
        cost=0.03,
    )
    return frames, model


def tilted_body(p: np.ndarray) -> Solid:
    """The box in its own frame, base on z = 0."""
    return solids.box(p[7:10], (0.0, 0.0, p[9] / 2))


def tilted_pose(frames: list[np.ndarray], p: np.ndarray) -> np.ndarray:
    """T_world_object (4, 4); the parameters hold the box centre, the object's origin is the centre of its base."""
    rotation = lie.rotation(p[1:4]) @ frames[round(float(p[0]))]
    return transforms.rigid(rotation, p[4:7] - rotation[:, 2] * p[9] / 2)


def _frames(evidence: Evidence) -> list[np.ndarray]:
    """Orientations with axes normal to the largest seen faces, and the most upright axis as z."""
    step = max(1, len(evidence.points) // 4000)
    points, normals, sigma = (each[::step] for each in (evidence.points, evidence.normals, evidence.point_sigma))
    first = planes.largest(points, sigma, np.random.default_rng(0))
    if first is None or first[1].mean() < LEAST_PART:
        return []
    (normal, _), _ = first
    aside = np.abs(normals @ normal) < ASIDE
    if aside.mean() > 0.5 * LEAST_PART:
        second = planes.largest(points[aside], sigma[aside], np.random.default_rng(0), least=LEAST_FACE)
        if second is not None and abs(second[0][0] @ normal) < ASIDE:
            return [_upright_frame(normal, second[0][0])]
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    along = np.cross(normal, helper)
    turns = np.deg2rad([0.0, 22.5, 45.0, 67.5])
    return [_upright_frame(normal, lie.rotation(normal * turn) @ along) for turn in turns]


def _upright_frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    a = first / np.linalg.norm(first)
    b = second - (second @ a) * a
    axes = np.stack([a, b / np.linalg.norm(b), np.cross(a, b / np.linalg.norm(b))])
    order = np.argsort(np.abs(axes[:, 2]), kind="stable")
    z, x = axes[order[2]] * np.sign(axes[order[2], 2] or 1.0), axes[order[0]]
    return np.stack([x, np.cross(z, x), z], axis=-1)


def deepened(low: np.ndarray, high: np.ndarray, sight: np.ndarray, part: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends (3,) of a box around seen points, extended away from the camera along the axis with the least extent.

    Args:
        low: Low ends of the points [m].
        high: High ends.
        sight: Line of sight (3,) in the axes of the box.
        part: Minimum depth along that axis, as a fraction of the median size.
    """
    size = high - low
    thin = int(np.argmin(size))
    extra = max(0.0, part * float(np.median(size)) - float(size[thin]))
    low, high = low.copy(), high.copy()
    if sight[thin] > 0:
        high[thin] += extra
    else:
        low[thin] -= extra
    return low, np.maximum(high, low + SMALLEST_M)
