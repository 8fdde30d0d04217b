"""Bodies of stacked cross-sections about a vertical axis: cylinders, revolved profiles, oval bottles, vessels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid

from .evidence import Evidence
from .hypothesis_box import LARGEST_M, SMALLEST_M, upright
from .refine import Model

THINNEST_M = 0.0012
"""No wall is thinner [m]."""
FACETS = 60
"""Corners of a finished cross-section."""


@dataclass(frozen=True)
class Profile:
    """Cross-sections by height: superellipses with half-axes `a` along x and `b` along y, maybe with a cavity."""

    heights: np.ndarray  # (K,) from 0 up [m]
    a: np.ndarray  # (K,) [m]
    b: np.ndarray  # (K,) [m]
    exponent: float = 2.0
    wall: np.ndarray | None = None  # (K,) wall thickness [m]; None makes it solid
    floor: float = 0.0  # height of the cavity's floor [m]

    def finer(self, count: int) -> Profile:
        """The same profile at `count` heights, joined by a smooth curve that never overshoots."""
        from scipy.interpolate import PchipInterpolator

        heights = np.linspace(0.0, self.heights[-1], count)
        curves = [None if c is None else PchipInterpolator(self.heights, c)(heights) for c in (self.a, self.b, self.wall)]
        return Profile(heights, curves[0], curves[1], self.exponent, curves[2], self.floor)

    def outer(self, facets: int) -> np.ndarray:
        """Rings (K, facets, 3) of the outside, from the base up."""
        rows = zip(self.a, self.b, self.heights, strict=True)
        return np.stack([solids.ring(a, b, self.exponent, z, facets) for a, b, z in rows])

    def inner(self, facets: int) -> np.ndarray:
        """Rings of the cavity, from the rim down to the floor."""
        if self.wall is None:
            return np.zeros((0, facets, 3))
        heights = np.concatenate([[self.floor], self.heights[self.heights > self.floor + 1e-4]])
        a, b, wall = (np.interp(heights, self.heights, curve) for curve in (self.a, self.b, self.wall))
        a, b = np.maximum(a - wall, SMALLEST_M / 3), np.maximum(b - wall, SMALLEST_M / 3)
        rows = list(zip(a, b, heights, strict=True))[::-1]
        return np.stack([solids.ring(x, y, self.exponent, z, facets) for x, y, z in rows])

    def solid(self, facets: int) -> Solid:
        """The closed body in its own frame, base on z = 0."""
        return solids.loft(np.concatenate([self.outer(facets), self.inner(facets)]))


@dataclass(frozen=True)
class Layout:
    """How a parameter vector describes a profile: x, y, [yaw, exponent], height, a..., [b ratios...], [walls..., floor]."""

    knots: int
    oval: bool = False
    ratios: int = 3
    hollow: bool = False

    def profile(self, p: np.ndarray) -> Profile:
        """The profile that the parameters stand for."""
        at = 4 if self.oval else 2
        height = float(p[at])
        heights = np.linspace(0.0, height, self.knots)
        a = p[at + 1 : at + 1 + self.knots]
        at += 1 + self.knots
        b, exponent = a, 2.0
        if self.oval:
            ratio = np.interp(heights, np.linspace(0.0, height, self.ratios), p[at : at + self.ratios])
            b, exponent = a * ratio, float(p[3])
            at += self.ratios
        if not self.hollow:
            return Profile(heights, a, b, exponent)
        wall = np.minimum(p[at : at + self.knots], 0.8 * np.minimum(a, b))
        return Profile(heights, a, b, exponent, wall, float(np.clip(p[at + self.knots], THINNEST_M, 0.9 * height)))

    def pose(self, p: np.ndarray) -> np.ndarray:
        """T_world_object (4, 4)."""
        return upright(p[0], p[1], p[2] if self.oval else 0.0)

    def build(self, p: np.ndarray) -> Solid:
        """The body in the world frame, coarse enough for a search."""
        return self.profile(p).solid(40).moved(self.pose(p))


CYLINDER = Layout(knots=2)


def cylinder(evidence: Evidence) -> Model:
    """An upright cylinder: x, y, height, and one radius twice."""
    centre, radius = axis(evidence)
    start = np.array([*centre, evidence.height, radius])
    return Model(
        name="cylinder",
        build=lambda p: CYLINDER.build(_twice(p)),
        starts=[start],
        steps=np.array([0.003, 0.003, 0.003, 0.002]),
        lower=np.array([-np.inf, -np.inf, SMALLEST_M, SMALLEST_M]),
        upper=np.array([np.inf, np.inf, LARGEST_M, LARGEST_M / 2]),
    )


def _twice(p: np.ndarray) -> np.ndarray:
    return np.array([*p, p[3]])


def revolved(evidence: Evidence, *, hollow: bool, wall_m: float) -> tuple[Layout, Model]:
    """A profile turned about a vertical axis; with `hollow` there is a cavity that is open upwards."""
    height = evidence.height
    knots = int(np.clip(round(height / 0.02), 5, 9 if hollow else 12))
    layout = Layout(knots=knots, hollow=hollow)
    centre, typical = axis(evidence)
    radii = outer_radii(evidence, centre, typical, np.linspace(0.0, height, knots))
    start = [*centre, height, *radii]
    steps = [0.003, 0.003, 0.003] + [0.002] * knots
    low = [-np.inf, -np.inf, SMALLEST_M] + [SMALLEST_M / 2] * knots
    high = [np.inf, np.inf, LARGEST_M] + [LARGEST_M / 2] * knots
    expected, spread = list(start), [np.inf] * 3 + [0.05] * knots
    if hollow:
        floor = cavity_floor(evidence, centre, typical, wall_m)
        start += [wall_m] * knots + [floor]
        expected = list(start)
        steps += [0.0015] * knots + [0.003]
        low += [THINNEST_M] * knots + [THINNEST_M]
        high += [max(4 * wall_m, 0.3 * typical)] * knots + [0.9 * height]
        spread += [0.002] * knots + [0.02]
    model = Model(
        name="revolved_hollow" if hollow else "revolved",
        build=layout.build,
        starts=[np.array(start)],
        steps=np.array(steps),
        lower=np.array(low),
        upper=np.array(high),
        expected=np.array(expected),
        spread=np.array(spread),
        cost=0.01,
    )
    return layout, model


def oval(evidence: Evidence) -> tuple[Layout, Model]:
    """Stacked superellipses with two planes of symmetry: a bottle or a carton with rounded corners."""
    height = evidence.height
    knots = int(np.clip(round(height / 0.018), 5, 12))
    layout = Layout(knots=knots, oval=True)
    facing = float(np.arctan2(-evidence.forward[0], evidence.forward[1]))
    starts = []
    for turn in np.deg2rad([0.0, 20.0, -20.0, 40.0, -40.0, 65.0, -65.0, 90.0]):
        starts.append(_oval_start(evidence, facing + turn, knots, layout.ratios))
    steps = [0.003, 0.003, 0.04, 0.2, 0.003] + [0.002] * knots + [0.06] * layout.ratios
    model = Model(
        name="oval",
        build=layout.build,
        starts=starts,
        steps=np.array(steps),
        lower=np.array([-np.inf] * 3 + [1.7, SMALLEST_M] + [SMALLEST_M / 2] * knots + [0.2] * layout.ratios),
        upper=np.array([np.inf] * 3 + [8.0, LARGEST_M] + [LARGEST_M / 2] * knots + [1.6] * layout.ratios),
        expected=starts[0],
        spread=np.array([np.inf] * 3 + [1.0, np.inf] + [0.05] * knots + [0.4] * layout.ratios),
        cost=0.02,
    )
    return layout, model


def _oval_start(evidence: Evidence, yaw: float, knots: int, ratios: int) -> np.ndarray:
    """Half-axes from the widths of the seen points in slices, and the axis behind the front by the depth's half-axis."""
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    u, v, z = evidence.points[:, :2] @ along, evidence.points[:, :2] @ across, evidence.points[:, 2]
    heights = np.linspace(0.0, evidence.height, knots)
    reach = evidence.height / knots
    half, middle = np.full(knots, np.nan), np.full(knots, np.nan)
    for i, height in enumerate(heights):
        near = np.abs(z - height) < reach
        if near.sum() > 12:
            low, high = np.quantile(u[near], [0.02, 0.98])
            half[i], middle[i] = (high - low) / 2 + 0.002, (low + high) / 2
    good = np.isfinite(half)
    half = np.interp(heights, heights[good], half[good]) if good.any() else np.full(knots, 0.02)
    lateral = float(np.nanmedian(middle)) if good.any() else float(np.median(u))
    ratio = 0.7
    front = float(np.quantile(v, 0.05))
    depth = front + ratio * float(half.max())
    centre = along * lateral + across * depth
    return np.array([*centre, yaw, 2.3, evidence.height, *half, *[ratio] * ratios])


def axis(evidence: Evidence) -> tuple[np.ndarray, float]:
    """Where a vertical axis (2,) is that the seen normals point at or away from, and the typical radius [m].

    A surface of revolution, convex or the inside of a cup, has all its normals in planes through the axis.
    """
    level = np.linalg.norm(evidence.normals[:, :2], axis=1)
    side = level > 0.35
    if side.sum() < 30:
        middle = np.median(evidence.points[:, :2], axis=0)
        return middle, float(np.quantile(np.linalg.norm(evidence.points[:, :2] - middle, axis=1), 0.95))
    points, normals = evidence.points[side, :2], evidence.normals[side, :2] / level[side, None]
    rows = np.stack([normals[:, 1], -normals[:, 0]], axis=-1)
    right = (rows * points).sum(axis=1)
    weight = np.ones(len(points))
    centre = points.mean(axis=0)
    for _ in range(15):
        # A weak pull to where the points are keeps flat fronts, whose normals are all parallel, from running away.
        normal = (rows * weight[:, None]).T @ rows + 1e-3 * len(points) * np.eye(2)
        centre = np.linalg.solve(normal, (rows * weight[:, None]).T @ right + 1e-3 * len(points) * points.mean(axis=0))
        weight = 1.0 / (1.0 + ((rows @ centre - right) / 0.004) ** 2)
    return centre, float(np.median(np.linalg.norm(points - centre, axis=1)))


def sides(evidence: Evidence, centre: np.ndarray) -> np.ndarray:
    """Cosine (N,) between the level part of each normal and the direction away from the axis: 1 outside, -1 inside."""
    out = evidence.points[:, :2] - centre
    out = out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    return np.asarray((evidence.normals[:, :2] * out).sum(axis=1))


def interior(evidence: Evidence, centre: np.ndarray) -> float:
    """Part of the trusted points that lie on walls facing the axis, well below the rim: a cavity is seen."""
    below = evidence.points[:, 2] < evidence.height - 0.006
    return float(((sides(evidence, centre) < -0.35) & below).mean())


def outer_radii(evidence: Evidence, centre: np.ndarray, typical: float, heights: np.ndarray) -> np.ndarray:
    """Radius at each height from the points that face away from the axis [m]; gaps are bridged."""
    outside = sides(evidence, centre) > 0.3
    radius = np.linalg.norm(evidence.points[:, :2] - centre, axis=1)
    reach = max((heights[1] - heights[0]) * 0.7, 0.004)
    found = np.full(len(heights), np.nan)
    for i, height in enumerate(heights):
        near = outside & (np.abs(evidence.points[:, 2] - height) < reach)
        if near.sum() > 8:
            found[i] = np.median(radius[near])
    good = np.isfinite(found)
    if not good.any():
        return np.full(len(heights), max(typical, SMALLEST_M))
    return np.asarray(np.interp(heights, heights[good], found[good]))


def cavity_floor(evidence: Evidence, centre: np.ndarray, typical: float, wall_m: float) -> float:
    """Height of the cavity's floor [m]: the lowest seen inside, or one wall where it is hidden."""
    inside = (sides(evidence, centre) < 0.0) | (evidence.normals[:, 2] > 0.9)
    inside &= np.linalg.norm(evidence.points[:, :2] - centre, axis=1) < typical
    inside &= evidence.points[:, 2] < 0.5 * evidence.height
    if inside.sum() < 30:
        return wall_m
    return float(np.clip(np.quantile(evidence.points[inside, 2], 0.1), wall_m, 0.5 * evidence.height))
