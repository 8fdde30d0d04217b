"""Convex pieces of objects in a reference world, from the same parameters as their surfaces.

A convex body is one piece. A vessel consists of a floor and slabs around its ring, which keep the cavity open; the
inner face of a slab is a chord, which fills a little of the cavity.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dextera_build.artifacts.shapes.mesh import Hull, Mesh

SECTORS = 24
"""Number of slabs around the ring; their chords fill 1.1 % of a round cavity."""
COLUMNS = 4
"""Facets of the outside per slab, as in the surface with 96 facets."""
BULGE_M = 0.001
"""A slab is split in height if it would bulge farther than this beyond the wall [m]."""
RINGS = 3
"""Sections of a bent bar per piece."""


def whole(mesh: Mesh) -> tuple[Hull, ...]:
    """The single piece of a convex surface."""
    return (Hull(vertices=mesh.vertices.copy()),)


def vessel(profile: np.ndarray) -> tuple[Hull, ...]:
    """Pieces of a surface of revolution about z, open at the top.

    Args:
        profile: (P, 2) radius and height, from the axis at the bottom, along the outside to the rim and down to the
            axis at the floor of the cavity; heights are monotonic on each side.
    """
    top = int(np.argmax(profile[:, 1]))
    outer, inner = profile[1 : top + 1], profile[top + 1 : -1][::-1]
    floor = float(profile[-1, 1])
    base = _between(outer, outer[0, 1], floor)
    angles = 2 * np.pi * np.arange(SECTORS * COLUMNS + 1) / (SECTORS * COLUMNS)
    hulls = [_turned(base, angles[:-1])]
    cuts = _cuts(outer, inner, floor)
    for low, high in pairwise(cuts):
        last = high == cuts[-1]
        skin = _between(outer, low, float(outer[-1, 1]) if last else high)
        lining = _between(inner, low, high)
        for sector in range(SECTORS):
            span = angles[sector * COLUMNS : (sector + 1) * COLUMNS + 1]
            points = np.concatenate([_ring(skin, span), _ring(lining, span[[0, -1]])])
            hulls.append(Hull(vertices=points.astype(np.float32)))
    return tuple(hulls)


def bar(tube: Mesh, rings: int) -> tuple[Hull, ...]:
    """Pieces of a bent bar from `solids.tube` with `rings` sections."""
    sections = tube.vertices[:-2].reshape(rings, -1, 3)
    starts = range(0, rings - 1, RINGS)
    return tuple(Hull(vertices=sections[start : start + RINGS + 1].reshape(-1, 3).copy()) for start in starts)


def _cuts(outer: np.ndarray, inner: np.ndarray, floor: float) -> list[float]:
    """Heights from the floor to the cavity's rim between which the wall is nearly convex."""
    heights = np.unique(np.concatenate([[floor], inner[:, 1], outer[outer[:, 1] > floor, 1]]))
    heights = heights[heights <= inner[-1, 1] + 1e-9]
    cuts = [0]
    while cuts[-1] < len(heights) - 1:
        end = len(heights) - 1
        while end > cuts[-1] + 1 and _bulge(outer, inner, heights[cuts[-1]], heights[end]) > BULGE_M:
            end -= 1
        cuts.append(end)
    return [float(heights[cut]) for cut in cuts]


def _bulge(outer: np.ndarray, inner: np.ndarray, low: float, high: float) -> float:
    """Radial distance by which the hull of the wall between two heights exceeds it [m]."""
    worst = 0.0
    for curve, sign in ((outer, -1.0), (inner, 1.0)):
        part = _between(curve, low, high)
        chord = np.interp(part[:, 1], [low, high], [part[0, 0], part[-1, 0]])
        worst = max(worst, float((sign * (part[:, 0] - chord)).max()))
    return worst


def _between(curve: np.ndarray, low: float, high: float) -> np.ndarray:
    """The part of a rising curve (N, 2) between two heights, including its points at both."""
    ends = np.array([[np.interp(z, curve[:, 1], curve[:, 0]), z] for z in (low, high)])
    inside = curve[(curve[:, 1] > low + 1e-9) & (curve[:, 1] < high - 1e-9)]
    return np.concatenate([ends[:1], inside, ends[1:]])


def _ring(curve: np.ndarray, angles: np.ndarray) -> np.ndarray:
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.c_[circle * r, np.full(len(circle), z)] for r, z in curve])


def _turned(curve: np.ndarray, angles: np.ndarray) -> Hull:
    return Hull(vertices=_ring(curve, angles).astype(np.float32))
