"""Place a model of unknown scale and orientation: try every orientation, judge by the render."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.view import Seen
from dextera_build.geometry import registration, transforms
from dextera_build.geometry.registration import Search, Similarity

from .model_view import ModelView, seen_points

if TYPE_CHECKING:
    from .icp_options import IcpOptions

_COARSE = 3000
"""Rays per render when ranking the starts."""
_SQUARE = np.radians(6.0)
"""A flat face nearer to level than this is made level, because objects stand on flat bases [rad]."""


def search(
    model: ModelView, vertices: np.ndarray, faces: np.ndarray, seen: Seen, options: IcpOptions
) -> tuple[Similarity, str]:
    """The best placement over 6 up directions x 24 turns, and 600 rotations spread over SO(3).

    Args:
        model: The model in front of the camera, at full resolution.
        vertices: (V, 3) in model units.
        faces: (F, 3) int.
        seen: The view.
        options: See `IcpOptions`.
    """
    coarse = ModelView(vertices, faces, seen, pixels=_COARSE)
    points = seen_points(seen)
    upright, tilted = _upright(), list(registration.spread_rotations(600))
    tried = []
    for rotations in (upright, tilted):
        for start in _finalists(coarse, vertices, seen, points, rotations, options.finalists):
            step = Search(registration.FREE, start.scale, options.start_scale_sigma, iterations=15)
            tried.append(registration.icp(start, coarse.visible, points, step))
    best = min(tried, key=lambda candidate: coarse.score(candidate).cost)
    # A handle or a lid fixes the yaw of a nearly round body; small refinement steps cannot find it.
    for start in _sorted(coarse, _turns(_surface_middle(vertices, faces), best))[:4]:
        step = Search(registration.FREE, start.scale, options.start_scale_sigma, iterations=15)
        tried.append(registration.icp(start, coarse.visible, points, step))
    best = min(tried, key=lambda candidate: coarse.score(candidate).cost)
    last = Search(registration.FREE, best.scale, options.start_scale_sigma, options.iterations)
    free = registration.icp(best, model.visible, points, last)
    ends = [best, free, *_squared(model, vertices, free, points, options)]
    final = min(ends, key=lambda candidate: model.score(candidate).cost)
    return final, f"best of {len(upright)} upright and {len(tilted)} tilted starts"


def _upright() -> list[np.ndarray]:
    """24 turns of each of the six rotations that point an axis up."""
    rotations = registration.cube_rotations()
    ups = [tuple(np.round(rotation[2]).astype(int).tolist()) for rotation in rotations]
    tops = [rotations[ups.index(up)] for up in sorted(set(ups))]
    return [yaw @ top for top in tops for yaw in registration.yaws(24)]


def _finalists(
    model: ModelView, vertices: np.ndarray, seen: Seen, points: np.ndarray, rotations: list[np.ndarray], most: int
) -> list[Similarity]:
    whole = np.array([_whole(seen.mask, seen.occluder), _whole(seen.mask.T, seen.occluder.T), False])
    starts = [_placed(vertices, seen, points, rotation, whole) for rotation in rotations]
    return _sorted(model, starts)[:most]


def _sorted(model: ModelView, starts: list[Similarity]) -> list[Similarity]:
    costs = [model.score(start).cost for start in starts]
    return [starts[index] for index in np.argsort(costs, kind="stable")]


def _surface_middle(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Centroid (3,) of the surface: near the axis of a round body, even with a handle."""
    corners = vertices[faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(np.average(corners.mean(axis=1), axis=0, weights=areas))


def _turns(centre: np.ndarray, placed: Similarity) -> list[Similarity]:
    """The placement turned about the vertical through `centre` (model frame), in 24 steps, without the first."""
    middle = placed.apply(centre[None])[0]
    turns = registration.yaws(24)[1:]
    poses = [transforms.rigid(turn, middle - turn @ middle) @ placed.pose for turn in turns]
    return [Similarity(placed.scale, pose) for pose in poses]


def _squared(
    model: ModelView, vertices: np.ndarray, placed: Similarity, points: np.ndarray, options: IcpOptions
) -> list[Similarity]:
    """The placement set flat on the downward face of its hull and refined; empty without such a face."""
    rotation = placed.pose[:3, :3]
    down = _base_normal(vertices, rotation)
    if down is None:
        return []
    upright = transforms.rotation_between(rotation @ down, np.array([0.0, 0.0, -1.0])) @ rotation
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    place = placed.apply(middle[None])[0] - placed.scale * upright @ middle
    square = Similarity(placed.scale, transforms.rigid(upright, place))
    lowest = float(square.apply(vertices)[:, 2].min())
    freedom = registration.UPRIGHT
    if abs(lowest) <= options.rest_m:
        freedom = registration.RESTING
        square = Similarity(placed.scale, transforms.rigid(upright, place - [0.0, 0.0, lowest]))
    search = Search(freedom, placed.scale, options.start_scale_sigma, options.iterations)
    return [registration.icp(square, model.visible, points, search)]


def _base_normal(vertices: np.ndarray, rotation: np.ndarray) -> np.ndarray | None:
    """Area-weighted model-frame normal (3,) of the hull faces that point down under `rotation`."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices)
    a, b, c = (vertices[hull.simplices[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals = hull.equations[:, :3]
    down = (normals @ rotation.T)[:, 2] < -np.cos(_SQUARE)
    if areas[down].sum() < 0.02 * areas.sum():
        return None
    total = (normals[down] * areas[down, None]).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))


def _whole(mask: np.ndarray, occluder: np.ndarray) -> bool:
    """Whether neither the image border nor an occluder cuts the mask's first and last column."""
    columns = np.flatnonzero(mask.any(axis=0))
    last = mask.shape[1] - 1
    if columns[0] <= 1 or columns[-1] >= last - 1:
        return False
    ends = ((columns[0], columns[0] - 2), (columns[-1], columns[-1] + 2))
    return all(float(occluder[mask[:, end], np.clip(beyond, 0, last)].mean()) < 0.3 for end, beyond in ends)


def _placed(
    vertices: np.ndarray, seen: Seen, points: np.ndarray, rotation: np.ndarray, whole: np.ndarray
) -> Similarity:
    """The model in one orientation, with scale and position from the seen extents."""
    camera_from_world = transforms.invert(seen.world_from_camera)
    local = transforms.apply(camera_from_world, points)
    turned = vertices @ (camera_from_world[:3, :3] @ rotation).T
    # If both axes are cut, there is nothing better.
    usable = whole if whole.any() else np.array([True, True, False])
    scale = registration.extent_scale(turned, local, usable) or 1.0
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2.0
    depth = float(turned[:, 2].max() - turned[:, 2].min()) * scale
    low, high = np.quantile(local, 0.01, axis=0), np.quantile(local, 0.99, axis=0)
    # Only the front half is visible; its nearest point is the model's nearest point.
    centre = np.array([*((low + high) / 2.0)[:2], low[2] + depth / 2.0])
    place = transforms.apply(seen.world_from_camera, (centre - scale * middle)[None])[0]
    return Similarity(scale, transforms.rigid(rotation, place))
