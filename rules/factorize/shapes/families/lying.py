"""Bodies of stacked cross-sections about a lying axis: bottles, tools and cans that fell over, pens, fruit."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import curves, lie, solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M
from .superquadric import GAP_M

KNOTS = 7
"""Cross-sections along the axis."""
FACETS = 32
"""Corners of a cross-section."""
BEND_RAD = 0.25
"""Standard deviation of the turn of the profile from one piece to the next [rad]."""
STEEPEST_RAD = 0.9
"""Maximum pitch of the axis [rad]."""
COST = 0.03
"""Complexity."""
_FIRST = 7
"""Index of the first half-width."""


def lying(evidence: Evidence) -> Model:
    """A profile about a lying axis.

    Parameters: x and y of the middle, yaw and pitch of the axis [rad], height of the lowest point [m], length [m],
    height over width of the cross-sections, and their half-widths by knot [m].
    """
    yaw = _yaw(evidence.points[:, :2])
    pitches = {0.0, _pitch(evidence, yaw)}
    starts = [_start(evidence, yaw + turn, pitch) for turn in (0.0, np.pi / 2, 0.3, -0.3) for pitch in sorted(pitches)]
    inf = np.inf
    bends = np.zeros((KNOTS - 2, _FIRST + KNOTS))
    for i in range(KNOTS - 2):
        bends[i, _FIRST + i : _FIRST + i + 3] = [1.0, -2.0, 1.0]
    return Model(
        name="lying",
        build=lambda p: (solid := body(p)).moved(pose(solid, p)),
        starts=starts,
        steps=np.array([0.003, 0.003, 0.03, 0.03, 0.002, 0.003, 0.06] + [0.002] * KNOTS),
        lower=np.array([-inf, -inf, -inf, -STEEPEST_RAD, -0.01, 2 * SMALLEST_M, 0.15] + [SMALLEST_M / 2] * KNOTS),
        upper=np.array([inf, inf, inf, STEEPEST_RAD, 0.3, LARGEST_M, 4.0] + [LARGEST_M / 2] * KNOTS),
        expected=np.array([0.0] * 6 + [1.0] + [float(np.median(starts[0][_FIRST:]))] * KNOTS),
        spread=np.array([inf] * 3 + [0.3, GAP_M, inf, 0.3] + [0.05] * KNOTS),
        smooth=bends / (BEND_RAD * starts[0][5] / (KNOTS - 1)),
        cost=COST,
    )


def body(p: np.ndarray, knots: int = 9, facets: int = FACETS) -> Solid:
    """The body in its own frame: axis along x, z up, the middle of the axis at the origin."""
    places = np.linspace(-0.5, 0.5, knots)
    widths = curves.monotone(np.linspace(-0.5, 0.5, KNOTS), p[_FIRST:], places)
    turn = np.arange(facets) * 2.0 * np.pi / facets
    circle = np.stack([np.zeros(facets), np.cos(turn), p[6] * np.sin(turn)], axis=-1)
    along = np.zeros((knots, 1, 3))
    along[:, 0, 0] = places * p[5]
    return solids.loft(circle[None] * widths[:, None, None] + along)


def pose(solid: Solid, p: np.ndarray) -> np.ndarray:
    """T_world_body (4, 4): the lowest point of the body is at the height of the parameters."""
    cos, sin = np.cos(p[3]), np.sin(p[3])
    pitch = np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    rotation = lie.about_z(p[2]) @ pitch
    low = float((solid.vertices @ rotation[2]).min())
    return transforms.rigid(rotation, np.array([p[0], p[1], p[4] - low]))


def _yaw(points: np.ndarray) -> float:
    """Direction of the longest spread of points (N, 2) [rad]."""
    axis = np.linalg.eigh(np.cov(points.T))[1][:, -1]
    return float(np.arctan2(axis[1], axis[0]))


def _pitch(evidence: Evidence, yaw: float) -> float:
    """Pitch of the axis [rad] along which the points rise."""
    along = evidence.points[:, :2] @ [np.cos(yaw), np.sin(yaw)]
    slope = float(np.polyfit(along - along.mean(), evidence.points[:, 2], 1)[0])
    return float(np.clip(np.arctan(slope), -STEEPEST_RAD, STEEPEST_RAD))


def _start(evidence: Evidence, yaw: float, pitch: float) -> np.ndarray:
    """Half-widths from the points in slices; the axis is one half-width behind the nearest points."""
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    u, v = evidence.points[:, :2] @ along, evidence.points[:, :2] @ across
    low, high = np.quantile(u, [0.01, 0.99])
    length = max(float(high - low), 4 * SMALLEST_M)
    half = np.full(KNOTS, np.nan)
    for i, place in enumerate(np.linspace(low, high, KNOTS)):
        near = np.abs(u - place) < length / KNOTS
        if near.sum() > 12:
            rise = evidence.points[near, 2]
            half[i] = (
                max(float(np.ptp(np.quantile(v[near], [0.02, 0.98]))), float(np.ptp(np.quantile(rise, [0.02, 0.98]))))
                / 2
            )
    good = np.isfinite(half)
    knots = np.arange(KNOTS)
    half = np.interp(knots, knots[good], half[good]) if good.any() else np.full(KNOTS, 0.02)
    half = np.maximum(half, SMALLEST_M)
    facing = float(evidence.forward @ across)
    near_side = float(np.quantile(v * np.sign(facing or 1.0), 0.05))
    middle = np.sign(facing or 1.0) * (near_side + float(np.median(half)))
    # Seen along its axis, the length is the seen depth.
    centre = along * (low + high) / 2 + across * middle
    return np.array([*centre, yaw, pitch, 0.0, length / max(np.cos(pitch), 0.5), 1.0, *half])
