"""Stacked cross-sections about a vertical axis, and their parameter vector."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dextera_build.geometry import curves, solids
from dextera_build.geometry.solids import Solid

from .box import SMALLEST_M, upright

THINNEST_M = 0.0012
"""Minimum wall thickness [m]."""
BEND_RAD = 0.2
"""Standard deviation of the turn of a profile from one piece to the next [rad]."""
WALL_STEP_M = 0.0008
"""Standard deviation of the change of a wall's thickness from knot to knot [m]."""
FLOOR_M = 0.003
"""Standard deviation of the difference between a floor and the wall above it [m]."""
ROUND_M = 0.004
"""Height over which a cavity's floor rises to the wall if it is not seen [m]."""
ARC = 6
"""Rings of the cavity over that height."""
LID_RIM_M = 0.003
"""Width of the rim around a lid that lies lower, as those of cans do [m]."""
FACETS = 60
"""Corners of a finished cross-section; a multiple of `wall_pieces.SECTORS`."""


@dataclass(frozen=True)
class Profile:
    """Cross-sections by height: superellipses with half-axes `a` along x and `b` along y, and an optional cavity."""

    heights: np.ndarray  # (K,) from 0 up [m]
    a: np.ndarray  # (K,) [m]
    b: np.ndarray  # (K,) [m]
    exponent: float = 2.0
    wall: np.ndarray | None = None  # (K,) wall thickness [m]; None makes it solid
    floor: float = 0.0  # height of the cavity's floor at the axis [m]
    rising: float = 0.0  # height over which the floor rises to the wall, in a quarter of an ellipse twice as wide [m]
    recess: float = 0.0  # height of the rim above the lid of a body without a cavity [m]

    def finer(self, count: int) -> Profile:
        """The same profile at `count` heights, interpolated by a smooth curve without overshoot."""
        heights = np.linspace(0.0, self.heights[-1], count)
        a, b = (curves.monotone(self.heights, curve, heights) for curve in (self.a, self.b))
        wall = None if self.wall is None else curves.monotone(self.heights, self.wall, heights)
        return Profile(heights, a, b, self.exponent, wall, self.floor, self.rising, self.recess)

    def outer(self, facets: int) -> np.ndarray:
        """Rings (K, facets, 3) of the outside, from the base up."""
        rows = zip(self.a, self.b, self.heights, strict=True)
        return np.stack([solids.ring(a, b, self.exponent, z, facets) for a, b, z in rows])

    def inner(self, facets: int) -> np.ndarray:
        """Rings of the cavity, from the rim down to the floor; those of a lid without a cavity."""
        if self.wall is None:
            return self._lid(facets)
        rising = float(np.clip(self.rising, 1e-6, 0.9 * (self.heights[-1] - self.floor)))
        arc = self.floor + rising * (1.0 - np.cos(np.linspace(0.0, np.pi / 2, ARC)))
        heights = np.sort(np.concatenate([arc, self.heights[self.heights > self.floor + 1e-4]]))
        heights = heights[np.append(True, np.diff(heights) > 1e-4)]
        a, b, wall = (np.interp(heights, self.heights, curve) for curve in (self.a, self.b, self.wall))
        # A wide floor rises from the axis, a narrow one from twice its height away from the wall.
        below = np.clip(1.0 - (heights - self.floor) / rising, 0.0, 1.0)
        inset = 1.0 - np.sqrt(1.0 - below**2)
        a, b = (half - wall - inset * np.clip(half - wall, 0.0, 2.0 * rising) for half in (a, b))
        rows = [(max(x, SMALLEST_M / 3), max(y, SMALLEST_M / 3), z) for x, y, z in zip(a, b, heights, strict=True)]
        rows.reverse()
        return np.stack([solids.ring(x, y, self.exponent, z, facets) for x, y, z in rows])

    def _lid(self, facets: int) -> np.ndarray:
        top, narrowest = float(self.heights[-1]), float(min(self.a[-1], self.b[-1]))
        recess = min(self.recess, 0.5 * top)
        if recess < 1e-4 or narrowest < 2.0 * LID_RIM_M:
            return np.zeros((0, facets, 3))
        a, b = self.a[-1] - LID_RIM_M, self.b[-1] - LID_RIM_M
        return np.stack([solids.ring(a, b, self.exponent, z, facets) for z in (top, top - recess)])

    def solid(self, facets: int) -> Solid:
        """The closed body in its own frame, base on z = 0."""
        return solids.loft(np.concatenate([self.outer(facets), self.inner(facets)]))


@dataclass(frozen=True)
class Layout:
    """Parameters: x, y, [yaw, exponent], height, a by knot, [ratios b / a], [wall by knot, floor, rise], [recess]."""

    knots: int
    oval: bool = False
    ratios: int = 3
    hollow: bool = False
    lid: bool = False
    """Whether a body without a cavity may have a rim around a lower lid."""

    def split(self, p: np.ndarray) -> list[np.ndarray]:
        """Split the parameters: those before the half-axes, the half-axes, ratios, walls, floor and rise, recess."""
        own = [self.knots] + [self.ratios] * self.oval + [self.knots] * self.hollow
        return np.split(p, np.cumsum([5 if self.oval else 3, *own])[: 1 + self.oval + 2 * self.hollow + self.lid])

    def height(self, p: np.ndarray) -> float:
        """Height of the body [m]."""
        return float(p[4 if self.oval else 2])

    def profile(self, p: np.ndarray) -> Profile:
        """The profile with these parameters."""
        height, runs = self.height(p), self.split(p)
        heights = np.linspace(0.0, height, self.knots)
        a = b = runs[1]
        exponent = 2.0
        if self.oval:
            b = a * np.interp(heights, np.linspace(0.0, height, self.ratios), runs[2])
            exponent = float(p[3])
        if not self.hollow:
            return Profile(heights, a, b, exponent, recess=float(p[-1]) if self.lid else 0.0)
        wall = np.minimum(runs[-2], 0.8 * np.minimum(a, b))
        floor = float(np.clip(p[-2], THINNEST_M, 0.9 * height))
        return Profile(heights, a, b, exponent, wall, floor, float(p[-1]))

    def pose(self, p: np.ndarray) -> np.ndarray:
        """T_world_object (4, 4)."""
        return upright(p[0], p[1], p[2] if self.oval else 0.0)

    def build(self, p: np.ndarray) -> Solid:
        """The body in the world frame, coarse enough for a search."""
        return self.profile(p).solid(40).moved(self.pose(p))

    def finer(self, p: np.ndarray) -> tuple[Layout, np.ndarray]:
        """The layout with twice as many knots, and the parameters of the same profile in it."""
        layout = replace(self, knots=min(2 * self.knots - 1, 25))
        old, new = np.linspace(0, 1, self.knots), np.linspace(0, 1, layout.knots)
        runs = self.split(p)
        runs[1] = np.interp(new, old, runs[1])
        if self.hollow:
            runs[-2] = np.interp(new, old, runs[-2])
        return layout, np.concatenate(runs)

    def bends(self, height: float) -> np.ndarray:
        """Rows (R, P) that map parameters to profile bends and wall changes, in standard deviations."""
        first = 5 if self.oval else 3
        count = first + self.knots + self.oval * self.ratios + self.hollow * (self.knots + 2) + self.lid
        rows = np.zeros((max(self.knots - 2, 0), count))
        for i in range(self.knots - 2):
            rows[i, first + i : first + i + 3] = [1.0, -2.0, 1.0]
        # An unseen wall is as thick as the wall next to it, a floor about as thick as the wall.
        walls = np.zeros((self.knots - 1 if self.hollow else 0, count))
        for i in range(len(walls)):
            walls[i, first + self.knots + i : first + self.knots + i + 2] = [-1.0, 1.0]
        floor = np.zeros((1 if self.hollow else 0, count))
        if self.hollow:
            floor[0, [first + self.knots, -2]] = [-1.0, 1.0]
        # Turns of up to about a quarter radian from knot to knot cost little.
        return np.concatenate([rows / (BEND_RAD * height / (self.knots - 1)), walls / WALL_STEP_M, floor / FLOOR_M])
