"""Superquadrics in any pose, with a linear taper: rounded boxes, cylinders, ellipsoids and intermediate shapes.

The starts follow Solina and Bajcsy, "Recovery of parametric models from range images: the case for superquadrics with
global deformations" (PAMI 1990): Levenberg-Marquardt on the radial distance. Outliers are downweighted as in Liu et
al., "Robust and accurate superquadric recovery" (CVPR 2022). Their preference for the smallest body would reduce an
object seen from one side to a shell; a prior on the depth is used instead. `refine` then fits depth and silhouette.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares, lie, solids, transforms
from dextera_build.geometry.least_squares import Local, Schedule
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M
from .tilted import deepened

AROUND, ALONG = 24, 12
"""Facets around the axis and from pole to pole; multiples of 8 and 4, so that corners and rims are met exactly."""
SAMPLES = 500
"""Points of a radial fit."""
STEPS = 25
"""Levenberg-Marquardt steps of a radial fit."""
GAP_M = 0.004
"""Standard deviation of the height of the lowest point above the surface under the object [m]."""
ROUND = (0.15, 1.7)
"""Range of the exponents: from nearly a box to beyond an ellipsoid."""
DEEP = 0.7
"""Minimum depth of a start along the line of sight, as a fraction of the median size: its back is unseen."""
HELD = 0.05
"""Weight of the prior on the log sizes, relative to all points together."""
PART = 0.07
"""Distance at which a point has half its weight in a radial fit, as a fraction of the largest size."""
COST = 0.02
"""Complexity."""
_DIFFERENCES = np.array([1e-4] * 3 + [1e-3] * 3 + [1e-2] * 2)
"""Steps of the parameters of a radial fit for its derivatives."""


def superquadric(evidence: Evidence) -> tuple[list[np.ndarray], Model]:
    """Initial orientations (3, 3), and the model.

    Parameters: index of an orientation, a further rotation vector (3), x and y of the centre, height of the lowest
    point [m], half-axes (3) [m], exponents along and around the axis (2), taper: relative change of width from the
    middle to the end of the axis.
    """
    frames = _frames(evidence)
    starts = [start for number, frame in enumerate(frames) for start in _starts(evidence, number, frame)]
    inf = np.inf
    typical = float(np.median(starts[0][7:10]))
    model = Model(
        name="superquadric",
        build=lambda p: _placed(body(p, AROUND, ALONG), frames, p),
        starts=starts,
        steps=np.array([1e-9, 0.02, 0.02, 0.02, 0.003, 0.003, 0.002, 0.002, 0.002, 0.002, 0.06, 0.06, 0.04]),
        lower=np.array([-inf] * 6 + [-0.01] + [SMALLEST_M / 2] * 3 + [ROUND[0]] * 2 + [-0.6]),
        upper=np.array([inf] * 6 + [0.3] + [LARGEST_M / 2] * 3 + [ROUND[1]] * 2 + [0.6]),
        expected=np.array([0.0] * 7 + [typical] * 3 + [0.8, 0.8, 0.0]),
        spread=np.array([inf] * 6 + [GAP_M] + [0.5 * typical] * 3 + [0.5, 0.5, 0.3]),
        cost=COST,
    )
    return frames, model


def body(p: np.ndarray, around: int, along: int) -> Solid:
    """The body in its own frame, centre at the origin."""
    rise = np.linspace(-np.pi / 2, np.pi / 2, along + 1)[1:-1]
    turn = np.arange(around) * 2.0 * np.pi / around
    flat = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    rings = np.concatenate(
        [
            np.cos(rise)[:, None, None] * flat[None],
            np.broadcast_to(np.sin(rise)[:, None, None], (len(rise), around, 1)),
        ],
        axis=-1,
    )
    made = solids.loft(rings)
    poles = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    directions = np.concatenate([rings.reshape(-1, 3), poles])
    unit = directions * _radius(directions, p[10:12])[:, None]
    unit[:, :2] *= 1.0 + p[12] * unit[:, 2:]
    return Solid(unit * p[7:10], made.faces)


def pose(solid: Solid, frames: list[np.ndarray], p: np.ndarray) -> np.ndarray:
    """T_world_body (4, 4) of the centred body: its lowest point is at the height of the parameters."""
    rotation = lie.rotation(p[1:4]) @ frames[round(float(p[0]))]
    low = float((solid.vertices @ rotation[2]).min())
    return transforms.rigid(rotation, np.array([p[4], p[5], p[6] - low]))


def _placed(solid: Solid, frames: list[np.ndarray], p: np.ndarray) -> Solid:
    return solid.moved(pose(solid, frames, p))


def _radius(directions: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Distance (N,) of the surface with half-axes 1 from the origin along unit directions (N, 3)."""
    return np.asarray(_implicit(directions, exponents) ** -0.5)


def _implicit(points: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Inside-outside function (N,) to the power of the first exponent: scales with the square of the points."""
    along, around = exponents
    x, y, z = np.maximum(np.abs(points), 1e-9).T
    level = (x ** (2.0 / around) + y ** (2.0 / around)) ** (around / along)
    return np.asarray((level + z ** (2.0 / along)) ** along)


def _frames(evidence: Evidence) -> list[np.ndarray]:
    """Initial orientations: each principal axis of the points upright or horizontal, in plan and in space."""
    points = evidence.points
    flat = np.linalg.eigh(np.cov(points[:, :2].T))[1]
    level = np.eye(3)
    level[:2, :2] = flat if np.linalg.det(flat) > 0 else flat[:, ::-1]
    spread = np.linalg.eigh(np.cov(points.T))[1]
    spread = spread if np.linalg.det(spread) > 0 else -spread
    # The axis of exponents and taper is the third: upright, or along either of the others.
    return [frame[:, order] for frame in (level, spread) for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])]


def _starts(evidence: Evidence, number: int, frame: np.ndarray) -> list[np.ndarray]:
    """Parameters from a box of likely depth, and those fitted from there to the points alone."""
    points = evidence.points[:: max(1, len(evidence.points) // SAMPLES)] @ frame
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    sight = frame.T @ (np.median(evidence.points, axis=0) - evidence.eye)
    low, high = deepened(low, high, sight, DEEP)
    box = np.array([*(low + high) / 2, *np.log((high - low) / 2), 0.7, 0.7])
    return [_start(found, number, frame) for found in (box, _descended(points, box, PART * float((high - low).max())))]


def _start(found: np.ndarray, number: int, frame: np.ndarray) -> np.ndarray:
    centre, half = frame @ found[:3], np.exp(found[3:6])
    p = np.array([number, 0.0, 0.0, 0.0, centre[0], centre[1], 0.0, *half, *found[6:8], 0.0])
    # Nothing below the supporting surface is visible, and the body may float less than the points do.
    p[6] = max(0.0, centre[2] + float((body(p, AROUND, ALONG).vertices @ frame[2]).min()))
    return p


def _descended(points: np.ndarray, start: np.ndarray, near_m: float) -> np.ndarray:
    """Parameters (8,): centre, log half-axes, exponents, by robust Levenberg-Marquardt."""
    objective = _Distances(points, start, near_m)
    return least_squares.levenberg_marquardt(start, objective.at(start), objective, Schedule(STEPS))[0]


@dataclass(frozen=True)
class _Distances:
    """Robust (Cauchy) distances of points from a superquadric."""

    points: np.ndarray
    start: np.ndarray
    near_m: float

    def at(self, p: np.ndarray) -> np.ndarray:
        return _residuals(self.points, p, self.start, self.near_m)

    def value(self, seen: np.ndarray, before: np.ndarray) -> float:
        return float((_cauchy(before) * seen**2).sum())

    def local(self, p: np.ndarray, seen: np.ndarray) -> Local:
        slope = np.stack([self.at(p + step) - seen for step in np.diag(_DIFFERENCES)], axis=-1) / _DIFFERENCES
        found = least_squares.normal(slope, -seen, _cauchy(seen))
        return Local(found, np.diag(found.matrix) + 1e-12)

    def moved(self, p: np.ndarray, step: np.ndarray) -> np.ndarray:
        there = p + np.clip(step, -0.3, 0.3)
        there[6:8] = np.clip(there[6:8], *ROUND)
        return np.asarray(there)


def _cauchy(residual: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + np.square(residual)))


def _residuals(points: np.ndarray, p: np.ndarray, start: np.ndarray, near_m: float) -> np.ndarray:
    """Radial distances of points to the surface over `near_m`, and the prior on undetermined sizes."""
    own, half = points - p[:3], np.exp(p[3:6])
    root = np.sqrt(_implicit(own / half, p[6:8]))
    distance = np.linalg.norm(own, axis=1) * (1.0 - 1.0 / np.maximum(root, 1e-6)) / near_m
    held = (p[3:6] - start[3:6]) * np.sqrt(HELD * len(points))
    return np.concatenate([distance, held])
