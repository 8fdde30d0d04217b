"""Bodies of stacked cross-sections about a vertical axis: cylinders, revolved profiles, oval bottles, vessels."""

from __future__ import annotations

import numpy as np

from ..evidence import Evidence
from ..refine import Model
from .box import LARGEST_M, SMALLEST_M, upright
from .profile import ROUND_M, THINNEST_M, Layout, Profile
from .revolution import axis, cavity_floor, outer_radii

CYLINDER = Layout(knots=2)
RECESS_M, RECESS_SIGMA_M, DEEPEST_M = 0.002, 0.003, 0.008
"""Height of a rim above the lid inside it, where a fit starts, its standard deviation, and the largest one [m]."""
RECESS_STEP_M = 0.0015
"""Finite-difference step of that height [m]."""
TOP, LEAST_LID = 0.75, 0.04
"""Part of the height from which a level surface is a lid, and its smallest fraction of the points."""
SHALLOW, FOOT = 0.7, 0.6
"""Height over the radius below which a vessel is shallow, and the radius of the foot of such a vessel over that of its
rim, where a fit starts."""


def cylinder(evidence: Evidence) -> Model:
    """An upright cylinder: x, y, height, radius and, if its top is seen, by how much a rim is higher than the lid."""
    centre, radius = axis(evidence)
    recess = [RECESS_M] if lidded(evidence) else []
    return upright_cylinder([np.array([*centre, evidence.height, radius, *recess])])


def upright_cylinder(starts: list[np.ndarray]) -> Model:
    """The same from initial guesses (4,), or (5,) with a lid."""
    lid = len(starts[0]) - 4
    return Model(
        name="cylinder",
        build=lambda p: cylinder_profile(p).solid(40).moved(upright(p[0], p[1], 0.0)),
        starts=starts,
        steps=np.array([0.003, 0.003, 0.003, 0.002, *[RECESS_STEP_M] * lid]),
        lower=np.array([-np.inf, -np.inf, SMALLEST_M, SMALLEST_M, *[0.0] * lid]),
        upper=np.array([np.inf, np.inf, LARGEST_M, LARGEST_M / 2, *[DEEPEST_M] * lid]),
    )


def cylinder_profile(p: np.ndarray) -> Profile:
    """The cross-sections of an upright cylinder."""
    return Profile(np.array([0.0, p[2]]), p[[3, 3]], p[[3, 3]], recess=float(p[4]) if len(p) > 4 else 0.0)


def lidded(evidence: Evidence) -> bool:
    """Whether a level top is seen, which a rim may surround."""
    high = evidence.points[:, 2] > TOP * evidence.height
    return bool(((evidence.normals[:, 2] > 0.9) & high).mean() > LEAST_LID)


def revolved(evidence: Evidence, *, hollow: bool, wall_m: float) -> tuple[Layout, Model]:
    """A profile revolved about a vertical axis; `hollow` adds a cavity that is open at the top."""
    height = evidence.height
    knots = int(np.clip(round(height / 0.02), 5, 9 if hollow else 12))
    layout = Layout(knots=knots, hollow=hollow, lid=not hollow and lidded(evidence))
    centre, typical = axis(evidence)
    radii = outer_radii(evidence, centre, typical, np.linspace(0.0, height, layout.knots))
    start = [*centre, height, *radii]
    if hollow:
        start += [wall_m] * layout.knots + [cavity_floor(evidence, centre, typical, wall_m), ROUND_M]
    start += [RECESS_M] * layout.lid
    name = "revolved_hollow" if hollow else "revolved"
    starts = [np.array(start)]
    if hollow and height < SHALLOW * typical:
        # Of a plate, hardly more than the inside is seen: its outline fits a cone with its wide end down as well.
        widest = float(np.quantile(np.linalg.norm(evidence.points[:, :2] - centre, axis=1), 0.98))
        starts.append(starts[0].copy())
        starts[1][3 : 3 + layout.knots] = np.linspace(FOOT * widest, widest, layout.knots)
    return layout, model(layout, name, starts, wall_m)


def oval(evidence: Evidence) -> tuple[Layout, Model]:
    """Stacked superellipses with two planes of symmetry: a bottle or a carton with rounded corners."""
    layout = Layout(knots=int(np.clip(round(evidence.height / 0.018), 5, 12)), oval=True)
    facing = float(np.arctan2(-evidence.forward[0], evidence.forward[1]))
    turns = np.deg2rad([0.0, 20.0, -20.0, 40.0, -40.0, 65.0, -65.0, 90.0])
    starts = [_oval_start(evidence, facing + turn, layout) for turn in turns]
    return layout, model(layout, "oval", starts, 0.0)


def model(layout: Layout, name: str, starts: list[np.ndarray], wall_m: float) -> Model:
    """The model of a layout around its initial guesses.

    Args:
        layout: Meaning of the parameters.
        name: Name of the family.
        starts: Initial guesses; unseen parameters stay near the first one.
        wall_m: Wall thickness of unseen walls [m].
    """
    knots, inf = layout.knots, np.inf
    steps, low, high, spread = [0.003, 0.003], [-inf, -inf], [inf, inf], [inf, inf]
    if layout.oval:
        steps, low, high, spread = [*steps, 0.04, 0.2], [*low, -inf, 1.7], [*high, inf, 8.0], [*spread, inf, 1.0]
    steps += [0.003] + [0.002] * knots
    low += [SMALLEST_M] + [SMALLEST_M / 2] * knots
    high += [LARGEST_M] + [LARGEST_M / 2] * knots
    spread += [inf] + [0.05] * knots
    if layout.oval:
        steps, low = steps + [0.06] * layout.ratios, low + [0.2] * layout.ratios
        high, spread = high + [1.6] * layout.ratios, spread + [0.4] * layout.ratios
    if layout.hollow:
        thick = max(4 * wall_m, 0.3 * float(layout.split(starts[0])[1].max()))
        deep = 0.9 * layout.height(starts[0])
        steps, low = steps + [0.0015] * knots + [0.003, 0.003], low + [THINNEST_M] * (knots + 1) + [0.0]
        high, spread = high + [thick] * knots + [deep, deep], spread + [0.004] * knots + [0.02, 0.01]
    if layout.lid:
        steps, low, high, spread = [*steps, RECESS_STEP_M], [*low, 0.0], [*high, DEEPEST_M], [*spread, RECESS_SIGMA_M]
    return Model(
        name=name,
        build=layout.build,
        starts=starts,
        steps=np.array(steps),
        lower=np.array(low),
        upper=np.array(high),
        expected=starts[0],
        spread=np.array(spread),
        smooth=layout.bends(layout.height(starts[0])),
        cost=0.02 if layout.oval else 0.01,
    )


def _oval_start(evidence: Evidence, yaw: float, layout: Layout) -> np.ndarray:
    """Half-axes from the widths of the seen points in slices; the axis is one depth half-axis behind the front."""
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    u, v, z = evidence.points[:, :2] @ along, evidence.points[:, :2] @ across, evidence.points[:, 2]
    heights = np.linspace(0.0, evidence.height, layout.knots)
    half, middle = np.full(layout.knots, np.nan), np.full(layout.knots, np.nan)
    for i, height in enumerate(heights):
        near = np.abs(z - height) < evidence.height / layout.knots
        if near.sum() > 12:
            low, high = np.quantile(u[near], [0.02, 0.98])
            half[i], middle[i] = (high - low) / 2 + 0.002, (low + high) / 2
    good = np.isfinite(half)
    half = np.interp(heights, heights[good], half[good]) if good.any() else np.full(layout.knots, 0.02)
    lateral = float(np.nanmedian(middle)) if good.any() else float(np.median(u))
    ratio = 0.7
    depth = float(np.quantile(v, 0.05)) + ratio * float(half.max())
    centre = along * lateral + across * depth
    return np.array([*centre, yaw, 2.3, evidence.height, *half, *[ratio] * layout.ratios])
