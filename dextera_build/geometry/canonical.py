"""Up and front directions of an object, estimated from its shape and its colours.

Candidates are the 24 rotations that map axes of the object's own frame to z and x, because mesh frames are usually
aligned with the object, but with different up axes. Each criterion scores every direction; without a clear winner the
direction stays undecided.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DIRECTIONS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
"""The six directions of the object's own axes."""
CELLS = 24
"""Cells along each side of a height map."""
FLAT = 0.02
"""Height above the lowest point, over the object's size, that counts as contact."""
CLEAR = 0.3
"""Minimum margin of the best direction over the next one."""
WEIGHTS = {"holds": 2.2, "stands": 1.0, "upright": 0.5, "seen": 0.8}
"""Weight of each criterion in the sum; these and `CLEAR`, except for `seen`, which needs photographs, were chosen by
`tests.benchmarks.registration.canonical --choose`."""
REACH = 0.06
"""Minimum difference of the reach of a surface to two sides, relative to its size, for a handle or a spout."""
PATTERN = 0.05
"""Minimum difference of the colour variation of two sides, 0..1, for a label or a screen."""

Colours = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""sRGB (N, 3), 0..1, of points on faces (N,) at barycentric weights (N, 3)."""
Cast = Callable[[np.ndarray], np.ndarray]
"""Distances (...) to the surface along rays (..., 6), inf without a hit."""


@dataclass(frozen=True)
class Samples:
    """Points sampled uniformly on a surface."""

    points: np.ndarray  # (N, 3)
    normals: np.ndarray  # (N, 3) unit, outward where the mesh is oriented
    colours: np.ndarray  # (N, 3) sRGB 0..1

    @property
    def size(self) -> float:
        """Diagonal of the box around them."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


@dataclass(frozen=True)
class Judged:
    """A score for each of `DIRECTIONS`, and the criterion that decided."""

    scores: np.ndarray  # (6,), or (4,) for fronts
    reason: str  # criterion of the best

    @property
    def lead(self) -> float:
        """Best minus second best score."""
        first, second = np.sort(self.scores)[::-1][:2]
        return float(first - second)


def sample(vertices: np.ndarray, faces: np.ndarray, paint: Colours, count: int = 4000) -> Samples:
    """Sample points on a surface, deterministically."""
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    random = np.random.default_rng(0)
    picked = random.choice(len(areas), count, p=areas / areas.sum())
    one, two = np.sqrt(random.uniform(size=count)), random.uniform(size=count)
    weights = np.stack([1.0 - one, one * (1.0 - two), one * two], axis=1)
    points = (corners[picked] * weights[..., None]).sum(axis=1)
    return Samples(points, cross[picked] / np.maximum(areas[picked], 1e-30)[:, None], paint(picked, weights))


def ups(samples: Samples, cast: Cast, seen_up: np.ndarray | None = None) -> Judged:
    """Score of each direction as up.

    An object rests on a wide contact under its centre, does not tip, is open at the top if it is a container, and, if
    it stands on one of its sides in the photograph, stands upright there.

    Args:
        samples: Samples of the surface.
        cast: Rays against the surface.
        seen_up: (3,) up in the photograph, in the object's frame; None if unknown.
    """
    parts = {name: WEIGHTS[name] * values for name, values in judgements(samples, cast, seen_up).items()}
    total = np.sum(list(parts.values()), axis=0)
    best = int(np.argmax(total))
    means = {name: values[best] - float(np.mean(values)) for name, values in parts.items()}
    return Judged(total, max(means, key=lambda name: means[name]))


def judgements(samples: Samples, cast: Cast, seen_up: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """The criteria that `ups` adds up, (6,) each, about 0..1 and unweighted; same arguments."""
    parts = {
        "holds": np.array([_holds(samples, cast, up) for up in DIRECTIONS]),
        "stands": np.array([_stands(samples, up) for up in DIRECTIONS]),
        "upright": np.array([_elongation(samples, up) for up in DIRECTIONS]),
    }
    if seen_up is not None:
        parts["seen"] = (DIRECTIONS @ seen_up > np.cos(np.radians(25.0))).astype(np.float64)
    return parts


def fronts(samples: Samples, up: np.ndarray, turned: Callable[[float], bool]) -> tuple[np.ndarray, Judged]:
    """The four horizontal directions (4, 3), and the score of each as the front.

    A handle or spout points forwards; otherwise the front is the side with the largest colour variation; otherwise it
    is one of the two broad sides, undecided between them.

    Args:
        samples: Samples of the surface.
        up: One of `DIRECTIONS`.
        turned: Whether a rotation about `up` [rad] is a symmetry of the shape.
    """
    level = DIRECTIONS[np.abs(DIRECTIONS @ up) < 0.5]
    reach = np.array([_reach(samples, side) for side in level])
    lopsided = reach - reach[[int(np.argmin(level @ side)) for side in level]]
    if lopsided.max() > REACH and not turned(np.pi):
        return level, Judged(np.clip(lopsided, 0.0, None) / REACH, "reaches out")
    patterns = np.array([_pattern(samples, side) for side in level])
    ordered = np.sort(patterns)[::-1]
    if ordered[0] - ordered[1] > PATTERN:
        return level, Judged(patterns / PATTERN, "picture")
    widths = np.array([float(np.ptp(samples.points @ side)) for side in level])
    return level, Judged(1.0 - widths / widths.max(), "broad side")


def rotation(up: np.ndarray, front: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that maps `up` to z and `front` to x; both unit and orthogonal."""
    return np.array([front, np.cross(up, front), up])


def _stands(samples: Samples, up: np.ndarray) -> float:
    """Hull area of the ground contact relative to the area of the outline; 0 if the object tips."""
    from scipy.spatial import ConvexHull, QhullError

    heights = samples.points @ up
    flat = samples.points @ _level(up).T
    touching = flat[heights < heights.min() + FLAT * samples.size]
    try:
        base, outline = ConvexHull(touching), ConvexHull(flat)
    except (QhullError, ValueError):
        return 0.0
    margin = -float((base.equations[:, :2] @ flat.mean(axis=0) + base.equations[:, 2]).max())
    if margin < 0.0:
        return 0.0
    # `volume` of a two-dimensional hull is its area.
    share = float(base.volume / outline.volume)
    facing = samples.normals @ up
    level = float((np.abs(facing[heights < heights.min() + FLAT * samples.size]) > 0.9).mean())
    return float(0.5 * share + 0.5 * np.sqrt(share) * level)


def _holds(samples: Samples, cast: Cast, up: np.ndarray) -> float:
    """Mean depth over the outline of pools filled by rain from above, relative to the object's height, 0..1."""
    level = _level(up)
    flat, heights = samples.points @ level.T, samples.points @ up
    low, high = flat.min(axis=0), flat.max(axis=0)
    at = [low[k] + (np.arange(CELLS) + 0.5) / CELLS * (high[k] - low[k]) for k in range(2)]
    grid = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1)
    top = heights.max() + 0.1 * samples.size
    origins = grid @ level + top * up
    rays = np.concatenate([origins, np.broadcast_to(-up, origins.shape)], axis=-1)
    ground = top - cast(rays)
    inside = np.isfinite(ground)
    filled = _filled(np.where(inside, ground, heights.min()))
    depth = np.where(inside, filled - ground, 0.0)
    return float(depth.sum() / max(int(inside.sum()), 1) / max(float(np.ptp(heights)), 1e-12))


def _filled(ground: np.ndarray) -> np.ndarray:
    """Water levels over (H, W) heights with drainage at the border, iterated until pools are at outlet level."""
    level = np.full(ground.shape, ground.max())
    level[0], level[-1], level[:, 0], level[:, -1] = ground[0], ground[-1], ground[:, 0], ground[:, -1]
    for _ in range(ground.size):
        near = np.pad(level, 1, constant_values=ground.min())
        lowest = np.minimum.reduce([near[:-2, 1:-1], near[2:, 1:-1], near[1:-1, :-2], near[1:-1, 2:]])
        found = np.maximum(ground, np.minimum(level, lowest))
        if np.array_equal(found, level):
            break
        level = found
    return level


def _elongation(samples: Samples, up: np.ndarray) -> float:
    """1 if the height differs from both other sizes and these are equal, as for bottles and plates; otherwise less."""
    height = float(np.ptp(samples.points @ up))
    one, other = (float(np.ptp(samples.points @ axis)) for axis in _level(up))
    alike = min(one, other) / max(one, other)
    return float(alike * (1.0 - min(height, one, other) / max(height, one, other)))


def _reach(samples: Samples, side: np.ndarray) -> float:
    """Extent of the surface to a side of its centroid, relative to its size."""
    return float((samples.points @ side - np.median(samples.points @ side)).max() / samples.size)


def _pattern(samples: Samples, side: np.ndarray) -> float:
    """Standard deviation of the colours of surfaces that face a side, 0..1."""
    facing = np.abs(samples.normals @ side) > 0.7
    outside = (samples.points @ side) > np.quantile(samples.points @ side, 0.6)
    chosen = samples.colours[facing & outside]
    return float(chosen.std(axis=0).mean()) if len(chosen) > 30 else 0.0


def _level(up: np.ndarray) -> np.ndarray:
    """Two axes (2, 3) orthogonal to `up`, which is parallel to an axis of the frame."""
    return np.asarray(np.eye(3)[np.abs(up) < 0.5])
