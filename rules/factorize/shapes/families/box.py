"""Boxes and cylinders: an upright box, and a cylinder lying on the support."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model

SMALLEST_M = 0.003
"""Minimum edge length [m]."""
LARGEST_M = 1.5
"""Maximum edge length [m]."""
LEAN_RAD = 0.015
"""Standard deviation of the lean of an upright box [rad]."""


def upright(x: float, y: float, yaw: float, base: float = 0.0) -> np.ndarray:
    """T_world_object (4, 4) of a body at (`x`, `y`), turned by `yaw`, with its base at height `base` [m]."""
    return transforms.rigid(lie.about_z(yaw), np.array([x, y, base]))


def box(evidence: Evidence) -> Model:
    """An upright box: x, y, yaw, width, depth, height and, for the fit only, a lean along width and depth [rad].

    Cartons sag and planes are slightly wrong; without the lean, both would bias the sizes. `standing` removes it.
    """
    starts = []
    for angle in np.deg2rad(np.arange(0.0, 90.0, 7.5)):
        low, high = spans(evidence.points[:, :2], angle)
        starts.append(_start(low, high, angle, evidence.height))
    # Smallest rectangles around the footprint first: a wrong yaw enlarges them.
    starts.sort(key=lambda start: float(start[3] * start[4]))
    starts = starts[:4]
    likely = _likely_depth(starts[0])
    starts += [_deepened(start, evidence.forward, likely) for start in starts[:2]]
    starts = [np.array([*start, 0.0, 0.0]) for start in starts]
    edges = ([SMALLEST_M] * 3, [LARGEST_M] * 3)
    return Model(
        name="box",
        build=leaning_solid,
        starts=starts,
        steps=np.array([0.003, 0.003, 0.02, 0.003, 0.003, 0.003, 0.01, 0.01]),
        lower=np.array([-np.inf] * 3 + edges[0] + [-0.1, -0.1]),
        upper=np.array([np.inf] * 3 + edges[1] + [0.1, 0.1]),
        expected=np.array([0.0, 0.0, 0.0, likely, likely, evidence.height, 0.0, 0.0]),
        # Too weak to bias seen sizes, strong enough to hold an unseen depth.
        spread=np.array([np.inf, np.inf, np.inf, 0.1, 0.1, 0.1, LEAN_RAD, LEAN_RAD]),
    )


def standing(p: np.ndarray) -> Model:
    """The upright box with the sizes of the leaning box `p`, free to move and turn about its former centre."""
    start = stood_up(p)
    free = np.array([np.inf, np.inf, np.inf, 0.0, 0.0, 0.0])
    return Model(
        name="box",
        build=box_solid,
        starts=[start],
        steps=np.array([0.003, 0.003, 0.02, 0.003, 0.003, 0.003]),
        lower=np.where(free > 0, -np.inf, start),
        upper=np.where(free > 0, np.inf, start),
    )


def stood_up(p: np.ndarray) -> np.ndarray:
    """The upright box with the sizes and the centre of a leaning one."""
    middle = upright(p[0], p[1], p[2]) @ np.array([p[6] * p[5] / 2, p[7] * p[5] / 2, 0.0, 1.0])
    return np.array([*middle[:2], *p[2:6]])


def leaning_solid(p: np.ndarray) -> Solid:
    """The sheared box in the world frame."""
    body = box_body(p)
    shear = np.eye(3)
    shear[:2, 2] = p[6:8]
    return Solid(body.vertices @ shear.T, body.faces).moved(upright(p[0], p[1], p[2]))


def box_solid(p: np.ndarray) -> Solid:
    """The box in the world frame."""
    return box_body(p).moved(upright(p[0], p[1], p[2]))


def box_body(p: np.ndarray) -> Solid:
    """The box in its own frame, base on z = 0."""
    return solids.box(p[3:6], (0.0, 0.0, p[5] / 2))


def spans(points: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Low and high ends (2,) of points (N, 2) along axes turned by `angle`, with 1 % trimmed on each side [m]."""
    turned = points @ lie.about_z(angle)[:2, :2]
    return np.quantile(turned, 0.01, axis=0), np.quantile(turned, 0.99, axis=0)


def _start(low: np.ndarray, high: np.ndarray, angle: float, height: float) -> np.ndarray:
    middle, size = (low + high) / 2, np.maximum(high - low, 2 * SMALLEST_M)
    x = np.cos(angle) * middle[0] - np.sin(angle) * middle[1]
    y = np.sin(angle) * middle[0] + np.cos(angle) * middle[1]
    return np.array([x, y, angle, size[0], size[1], height])


def _likely_depth(start: np.ndarray) -> float:
    """Likely depth of a box with only its front in view [m]: cartons are about half as deep as narrow."""
    return max(0.55 * float(min(max(start[3:5]), start[5])), 2 * SMALLEST_M)


def _deepened(start: np.ndarray, forward: np.ndarray, depth: float) -> np.ndarray:
    """The same box made at least `depth` [m] deep, with its front face fixed."""
    axes = lie.about_z(-start[2])[:2, :2]
    along = axes @ forward
    thin = int(np.argmax(np.abs(along)))
    grown = start.copy()
    extra = max(0.0, depth - float(start[3 + thin])) / 2
    grown[3 + thin] += 2 * extra
    grown[:2] += extra * np.sign(along[thin]) * axes[thin]
    return grown


def lying(evidence: Evidence) -> Model:
    """A cylinder lying on the support: x, y, yaw of its axis, radius, length."""
    radius = evidence.height / 2
    starts = []
    for angle in np.deg2rad(np.arange(0.0, 180.0, 15.0)):
        low, high = spans(evidence.points[:, :2], angle)
        start = _start(low, high, angle, evidence.height)
        centre = start[:2] + evidence.forward * max(0.0, radius - (high - low)[1] / 2)
        starts.append(np.array([centre[0], centre[1], angle, radius, max(start[3], 2 * SMALLEST_M)]))
    return Model(
        name="lying_cylinder",
        build=lying_solid,
        starts=starts,
        steps=np.array([0.003, 0.003, 0.02, 0.002, 0.003]),
        lower=np.array([-np.inf, -np.inf, -np.inf, SMALLEST_M, SMALLEST_M]),
        upper=np.array([np.inf, np.inf, np.inf, LARGEST_M / 2, LARGEST_M]),
    )


def lying_solid(p: np.ndarray) -> Solid:
    """The lying cylinder in the world frame."""
    return lying_body(p).moved(upright(p[0], p[1], p[2]))


def lying_body(p: np.ndarray, facets: int = 40) -> Solid:
    """The lying cylinder in its own frame: axis along x, base on z = 0."""
    turn = np.arange(facets) * 2 * np.pi / facets
    # Counter-clockwise about +x: rings from -x to +x have outward normals.
    circle = np.stack([np.zeros(facets), p[3] * np.cos(turn), p[3] * np.sin(turn) + p[3]], axis=-1)
    ends = np.array([[-p[4] / 2, 0, 0], [p[4] / 2, 0, 0]])
    return solids.loft(circle[None] + ends[:, None])
