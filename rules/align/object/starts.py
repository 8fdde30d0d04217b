"""Place a model of unknown scale and orientation: try all orientations, judge them by renders."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import lie, metrics, registration, transforms
from dextera_build.geometry.registration import ScaledPose, Search

from . import proposals
from .model_view import ModelView, seen_points

if TYPE_CHECKING:
    from .icp_options import IcpOptions

_RAYS, _FEW = 2500, 900
"""Rays per render when judging and when registering candidates."""
_POINTS = 250
"""Number of seen points that candidates are registered to."""
_SAMPLES = 200
"""Number of surface points of the model whose projections rank the starts."""
_SPREAD = 600
"""Number of rotations distributed over SO(3)."""
_GROWN = (1.15, 1.5, 2.0)
"""Sizes, relative to the visible part, that are tried if both ends of every axis may be occluded."""
_SIZES = (0.85, 1.0, 1.2, 1.6)
"""Sizes, relative to the visible part, that are tried with more starts if no placement explained the mask."""
_LAST = 3
"""Number of candidates that are registered fully."""
_ALIKE = 0.03
"""Difference in cost below which two placements are equally good."""
_TOUCHING_M = 0.003
"""Depth below the support that noise may cause [m]."""
_SQUARE = np.radians(6.0)
"""A flat face with a smaller tilt is made level, because objects stand on flat bases [rad]."""


class Found(NamedTuple):
    """Result of a search."""

    best: ScaledPose
    others: list[ScaledPose]  # equally good placements
    method: str


def search(model: ModelView, vertices: np.ndarray, faces: np.ndarray, seen: Seen, options: IcpOptions) -> Found:
    """The best placement over 6 up directions x 24 turns, and 600 rotations distributed over SO(3).

    All are ranked by projections of surface points; the best ones with distinct rotations are registered with few
    points. The best of these are also rotated about the vertical and about the model's principal axes, because
    similar-looking placements differ by such rotations. The remaining ones are registered with all points and judged by
    their renders.

    Args:
        model: The model in front of the camera, at full resolution.
        vertices: (V, 3) in model units.
        faces: (F, 3) int.
        seen: The view.
        options: See `IcpOptions`.
    """
    judge, few = model.coarser(seen, _RAYS), model.coarser(seen, _FEW)
    points, samples = seen_points(seen, _POINTS), metrics.sample_surface(vertices, faces, _SAMPLES, 0)
    hull = _hull(vertices)
    corners = vertices if hull is None else vertices[hull.vertices]

    def cost(placed: ScaledPose) -> float:
        return judge.score(placed).cost + _sunk(corners, placed)

    def registered(starts: list[ScaledPose], iterations: int) -> list[ScaledPose]:
        step = [Search(lie.FREE, one.scale, options.start_scale_sigma, model.noise_m, iterations) for one in starts]
        return [registration.icp(one, few.visible, points, how) for one, how in zip(starts, step, strict=True)]

    centre = metrics.surface_centroid(vertices, faces)
    ends: list[ScaledPose] = []
    enough = options.enough_cost + 0.8 * model.noise_m / 0.02
    for more in (1, 4):
        starts = ranked(samples, seen, options.finalists * more, more)
        tried = _sorted(cost, registered(starts, options.coarse_iterations))
        turned = _sorted(cost, [turn for one in tried[:2] for turn in _turns(samples, centre, one)])
        tried = _sorted(cost, tried + registered(turned[: options.finalists // 2], options.coarse_iterations))
        last = _distinct(tried, _LAST)
        ends = _sorted(cost, [*ends, *last, *registered(last, options.coarse_iterations)])
        if cost(ends[0]) < enough:
            break
    others = [one for one in _distinct(ends, _LAST)[1:] if cost(one) < cost(ends[0]) + _ALIKE]
    return Found(_finished(judge, corners, ends[0], seen, options), others, f"best of {144 + _SPREAD} starts")


def ranked(samples: np.ndarray, seen: Seen, most: int, more: int = 1) -> list[ScaledPose]:
    """The starts that agree best with mask and depth, with distinct rotations.

    Args:
        samples: (N, 3) of the surface.
        seen: The view.
        most: Maximum number of starts.
        more: Multiple of the usual number of rotations; above one, other sizes are tried if a side is hidden.
    """
    goal = proposals.target(seen)
    if goal is None:
        return []
    from_world = seen.world_from_camera[:3, :3].T
    rotations = np.array([from_world @ turn for turn in (*_upright(), *registration.spread_rotations(more * _SPREAD))])
    tries: tuple[float, ...] = (1.0,)
    if goal.open.any():
        tries = _GROWN if goal.open.any(axis=0).all() else (_SIZES if more > 1 else tries)
    made = [proposals.fitted(samples, rotations, goal, grow) for grow in tries]
    costs = np.concatenate([proposals.costs(samples, starts, goal) for starts in made])
    every = np.concatenate([rotations] * len(tries))
    chosen = proposals.different(every, np.argsort(costs, kind="stable"), most)
    return [proposals.in_world(made[k // len(rotations)], k % len(rotations), seen) for k in chosen]


def _upright() -> list[np.ndarray]:
    """24 rotations about each of the six up directions."""
    rotations = registration.cube_rotations()
    ups = [tuple(np.round(rotation[2]).astype(int).tolist()) for rotation in rotations]
    tops = [rotations[ups.index(up)] for up in sorted(set(ups))]
    return [yaw @ top for top in tops for yaw in registration.yaws(24)]


def _hull(vertices: np.ndarray) -> Any:
    """Convex hull; None for a flat mesh."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(vertices)
    except QhullError:
        return None


def _sunk(corners: np.ndarray, placed: ScaledPose) -> float:
    """Depth of the hull's lowest corner below the support, in units of 2 cm: no object is inside the table."""
    return max(0.0, -float(placed.apply(corners)[:, 2].min()) - _TOUCHING_M) / 0.02


def _sorted(cost: Callable[[ScaledPose], float], starts: list[ScaledPose]) -> list[ScaledPose]:
    costs = [cost(start) for start in starts]
    return [starts[index] for index in np.argsort(costs, kind="stable")]


def _distinct(ranked: list[ScaledPose], most: int) -> list[ScaledPose]:
    rotations = np.array([one.pose[:3, :3] for one in ranked])
    return [ranked[k] for k in proposals.different(rotations, np.arange(len(ranked)), most)]


def _turns(samples: np.ndarray, centre: np.ndarray, placed: ScaledPose) -> list[ScaledPose]:
    """The placement rotated about the vertical and the principal axes through `centre` (model frame), in 12 steps."""
    own = np.linalg.eigh(np.cov((samples - centre).T))[1].T @ placed.pose[:3, :3].T
    middle = placed.apply(centre[None])[0]
    return [
        ScaledPose(placed.scale, lie.turned(axis, middle, angle) @ placed.pose)
        for axis in (np.array([0.0, 0.0, 1.0]), *own)
        for angle in np.arange(1, 12) * np.pi / 6.0
    ]


def _finished(model: ModelView, corners: np.ndarray, start: ScaledPose, seen: Seen, options: IcpOptions) -> ScaledPose:
    """The candidate registered with more points, and placed flat if nearly so on a face of its hull's `corners`."""
    points = seen_points(seen, 3 * _POINTS)
    how = Search(lie.FREE, start.scale, options.start_scale_sigma, model.noise_m, options.iterations)
    free = registration.icp(start, model.visible, points, how)
    ends = [start, free, *_squared(model, corners, free, points, options)]
    return min(ends, key=lambda candidate: model.score(candidate).cost)


def _squared(
    model: ModelView, vertices: np.ndarray, placed: ScaledPose, points: np.ndarray, options: IcpOptions
) -> list[ScaledPose]:
    """The placement with the downward face of its hull flat on the support, refined; empty without such a face."""
    rotation = placed.pose[:3, :3]
    down = _base_normal(vertices, rotation)
    if down is None:
        return []
    upright = transforms.rotation_between(rotation @ down, np.array([0.0, 0.0, -1.0])) @ rotation
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    place = placed.apply(middle[None])[0] - placed.scale * upright @ middle
    square = ScaledPose(placed.scale, transforms.rigid(upright, place))
    lowest = float(square.apply(vertices)[:, 2].min())
    freedom = lie.UPRIGHT
    if abs(lowest) <= options.rest_m:
        freedom = lie.resting()
        square = ScaledPose(placed.scale, transforms.rigid(upright, place - [0.0, 0.0, lowest]))
    search = Search(freedom, placed.scale, options.start_scale_sigma, model.noise_m, options.iterations)
    return [registration.icp(square, model.visible, points, search)]


def _base_normal(vertices: np.ndarray, rotation: np.ndarray) -> np.ndarray | None:
    """Area-weighted model-frame normal (3,) of the hull faces that point down under `rotation`."""
    hull = _hull(vertices)
    if hull is None:
        return None
    a, b, c = (vertices[hull.simplices[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals = hull.equations[:, :3]
    down = (normals @ rotation.T)[:, 2] < -np.cos(_SQUARE)
    if areas[down].sum() < 0.02 * areas.sum():
        return None
    total = (normals[down] * areas[down, None]).sum(axis=0)
    return np.asarray(total / np.linalg.norm(total))
