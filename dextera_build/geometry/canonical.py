"""Which way up an object stands and which side is its front, judged from its shape and its colours.

Candidates are the 24 rotations that point the axes of the object's own frame along z and x: makers of meshes align
their frames with the object, but do not agree which axis is up. Each judgement is a number for each direction; what
none of them tells clearly stays undecided.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

DIRECTIONS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
"""The six directions of the own axes."""
CELLS = 24
"""Cells along each side of a height map."""
FLAT = 0.02
"""Height above the lowest point, over the object's size, that counts as contact."""
CLEAR = 0.3
"""Lead of the best direction over the next from which it is decided."""
WEIGHTS = {"holds": 2.2, "stands": 1.0, "upright": 0.5, "seen": 0.8}
"""Weight of each judgement in the sum; `tests.benchmarks.registration.canonical --choose` chose them and `CLEAR`, but
for `seen`, which needs photographs."""
REACH = 0.06
"""How much further a surface reaches to one side than to the other, over its size, for a handle or a spout."""
PATTERN = 0.05
"""How much more the colours of one side vary than those of the next, 0..1, for a label or a screen."""

Colours = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""sRGB (N, 3), 0..1, of points on faces (N,) at barycentric weights (N, 3)."""
Cast = Callable[[np.ndarray], np.ndarray]
"""Distances (...) to the surface along rays (..., 6), inf without a hit."""


@dataclass(frozen=True)
class Samples:
    """Points spread over a surface by area."""

    points: np.ndarray  # (N, 3)
    normals: np.ndarray  # (N, 3) unit, outward where the mesh is oriented
    colours: np.ndarray  # (N, 3) sRGB 0..1

    @property
    def size(self) -> float:
        """Diagonal of the box around them."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


@dataclass(frozen=True)
class Judged:
    """A number for each of `DIRECTIONS`, and what it came from."""

    scores: np.ndarray  # (6,), or (4,) for fronts
    reason: str  # of the best

    @property
    def lead(self) -> float:
        """Best minus second best."""
        first, second = np.sort(self.scores)[::-1][:2]
        return float(first - second)


def sample(vertices: np.ndarray, faces: np.ndarray, paint: Colours, count: int = 4000) -> Samples:
    """Spread points over a surface; the same ones for the same surface."""
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
    """How much each direction looks like up.

    An object rests on a wide contact that is under its middle, does not tip, is open upwards if it holds anything, and
    stands in the photograph as it is used, if it stands there on one of its sides.

    Args:
        samples: Of the surface.
        cast: Rays against the surface.
        seen_up: (3,) up in the photograph, in the object's frame; None if unknown.
    """
    parts = {name: WEIGHTS[name] * values for name, values in judgements(samples, cast, seen_up).items()}
    total = np.sum(list(parts.values()), axis=0)
    best = int(np.argmax(total))
    means = {name: values[best] - float(np.mean(values)) for name, values in parts.items()}
    return Judged(total, max(means, key=lambda name: means[name]))


def judgements(samples: Samples, cast: Cast, seen_up: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """What `ups` adds up, (6,) each, about 0..1 and not weighted; arguments as there."""
    parts = {
        "holds": np.array([_holds(samples, cast, up) for up in DIRECTIONS]),
        "stands": np.array([_stands(samples, up) for up in DIRECTIONS]),
        "upright": np.array([_elongation(samples, up) for up in DIRECTIONS]),
    }
    if seen_up is not None:
        parts["seen"] = (DIRECTIONS @ seen_up > np.cos(np.radians(25.0))).astype(np.float64)
    return parts


def fronts(samples: Samples, up: np.ndarray, turned: Callable[[float], bool]) -> tuple[np.ndarray, Judged]:
    """The four level directions (4, 3), and how much each looks like the front.

    A handle or spout points forwards; else the front is the side with the richest picture; else it is one of the two
    broad sides, and which of them stays open.

    Args:
        samples: Of the surface.
        up: One of `DIRECTIONS`.
        turned: Whether a turn about `up` [rad] is a symmetry of the shape.
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
    """(3, 3) that takes `up` to z and `front` to x; both unit, at right angles."""
    return np.array([front, np.cross(up, front), up])


def _stands(samples: Samples, up: np.ndarray) -> float:
    """Area under the middle: that of the hull of what touches the ground over that of the outline, 0 if it tips."""
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
    # `volume` of a plane hull is its area.
    share = float(base.volume / outline.volume)
    facing = samples.normals @ up
    level = float((np.abs(facing[heights < heights.min() + FLAT * samples.size]) > 0.9).mean())
    return float(0.5 * share + 0.5 * np.sqrt(share) * level)


def _holds(samples: Samples, cast: Cast, up: np.ndarray) -> float:
    """Depth of the pools that stay after rain from above, over the object's height, mean over its outline, 0..1."""
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
    """Water levels over (H, W) heights, water runs off over the border: lowered until every pool is at its outlet."""
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
    """1 if the height differs from both other sizes and these are alike, as with bottles and plates; else less."""
    height = float(np.ptp(samples.points @ up))
    one, other = (float(np.ptp(samples.points @ axis)) for axis in _level(up))
    alike = min(one, other) / max(one, other)
    return float(alike * (1.0 - min(height, one, other) / max(height, one, other)))


def _reach(samples: Samples, side: np.ndarray) -> float:
    """How far the surface reaches to a side of its centroid, over its size."""
    return float((samples.points @ side - np.median(samples.points @ side)).max() / samples.size)


def _pattern(samples: Samples, side: np.ndarray) -> float:
    """Standard deviation of the colours of what faces a side, 0..1."""
    facing = np.abs(samples.normals @ side) > 0.7
    outside = (samples.points @ side) > np.quantile(samples.points @ side, 0.6)
    chosen = samples.colours[facing & outside]
    return float(chosen.std(axis=0).mean()) if len(chosen) > 30 else 0.0


def _level(up: np.ndarray) -> np.ndarray:
    """Two axes (2, 3) at right angles to `up`, which is along an axis of the frame."""
    return np.asarray(np.eye(3)[np.abs(up) < 0.5])
