"""Cut a polygon with holes into few convex parts: triangles, joined while their hull adds almost nothing."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dextera_build.geometry import regions

SLIVER_M2 = 1e-6
"""Area of a part below which it is left out [m^2]."""


def convex_parts(rings: Sequence[np.ndarray], slack_m: float, most: int) -> list[np.ndarray]:
    """Convex polygons (P, 2), counter-clockwise, that cover the region that `rings` enclose an odd number of times.

    Neighbours are joined, cheapest first, in the manner of Hertel and Mehlhorn (1983), but a common hull may add area.

    Args:
        rings: Polygons (P, 2) [m].
        slack_m: Two parts are joined if their hull adds less area than this width over half of its perimeter [m].
        most: Maximum number of parts; joining continues beyond the slack until it is met.
    """
    parts = dict(enumerate(_triangles(rings)))
    near = _neighbours(parts)
    prices = {pair: _price(parts, pair) for pair in sorted(_pairs(near))}
    while prices:
        pair = min(prices, key=lambda key: (prices[key], key))
        if prices[pair] > slack_m and len(parts) <= most:
            break
        one, other = pair
        parts[one] = regions.convex_hull(np.concatenate([parts[one], parts.pop(other)]))
        near[one] = (near[one] | near.pop(other)) - {one, other}
        for index in near[one]:
            near[index] = (near[index] - {other}) | {one}
        prices = {key: price for key, price in prices.items() if not set(pair) & set(key)}
        prices |= {key: _price(parts, key) for key in ((min(one, i), max(one, i)) for i in sorted(near[one]))}
    # Slivers have no volume that a simulator accepts.
    return [part for part in parts.values() if regions.area(part) > SLIVER_M2]


def _triangles(rings: Sequence[np.ndarray]) -> list[np.ndarray]:
    import manifold3d as m3

    section = m3.CrossSection([np.asarray(ring, np.float64) for ring in rings], m3.FillRule.EvenOdd)
    polygons = [np.asarray(ring, np.float64) for ring in section.to_polygons()]
    corners = np.concatenate(polygons)
    found = [corners[np.asarray(triangle)] for triangle in m3.triangulate(polygons)]
    return [triangle for triangle in found if regions.area(triangle) > 1e-12]


def _neighbours(parts: dict[int, np.ndarray]) -> dict[int, set[int]]:
    """Parts that share an edge with each part."""
    owners: dict[tuple[tuple[float, ...], ...], list[int]] = {}
    for index, part in parts.items():
        corners = [tuple(corner.tolist()) for corner in part]
        for edge in zip(corners, [*corners[1:], corners[0]], strict=True):
            owners.setdefault(tuple(sorted(edge)), []).append(index)
    near: dict[int, set[int]] = {index: set() for index in parts}
    for sharing in owners.values():
        for one, other in combinations(sharing, 2):
            near[one].add(other)
            near[other].add(one)
    return near


def _pairs(near: dict[int, set[int]]) -> set[tuple[int, int]]:
    return {(min(one, other), max(one, other)) for one, others in near.items() for other in others}


def _price(parts: dict[int, np.ndarray], pair: tuple[int, int]) -> float:
    """Area that the common hull adds, over half of its perimeter [m]."""
    one, other = (parts[index] for index in pair)
    hull = regions.convex_hull(np.concatenate([one, other]))
    perimeter = float(np.linalg.norm(np.roll(hull, -1, axis=0) - hull, axis=1).sum())
    return 2.0 * (regions.area(hull) - regions.area(one) - regions.area(other)) / max(perimeter, 1e-9)
