"""Cut a container into convex pieces: wedges around the vertical, then the best plane of each piece.

General decompositions fill the cavity or take minutes (CoACD on a bowl: 44 pieces fill 9 %). A container's walls are
convex once cut across, so a few exact cuts do better: each cut is made on the closed solid, and pieces whose common
hull adds almost no volume are joined again.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.geometry import lie

if TYPE_CHECKING:
    from manifold3d import Manifold

_PLACES = (0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9)
"""Candidate cut positions, as fractions of a piece's extent."""
SLIVER_M3 = 1e-10
"""Volume of a hull that is flat once its corners are rounded to single precision [m^3]."""


def cut(solid: Manifold, sectors: int, excess_m3: float) -> list[Manifold]:
    """Convex hulls of adjacent pieces that together cover `solid`.

    Args:
        solid: Closed solid, z up.
        sectors: Wedges around the vertical through the middle of its bounding box.
        excess_m3: A piece is not cut further if its hull adds less than this [m^3].
    """
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    middle = (low + high) / 2.0
    pieces: list[Manifold] = []
    for number in range(sectors):
        first, last, centre = (2.0 * np.pi * (number + k) / sectors for k in (0.0, 1.0, 0.5))
        wedge = _keep(_keep(solid, first, middle, 1.0), last, middle, -1.0)
        frame = lie.about_z(-centre)
        for part in wedge.decompose():
            pieces += _cut(part, frame, excess_m3, depth=5)
    hulls = [piece.hull() for piece in pieces]
    return [hull for hull in hulls if hull.volume() > SLIVER_M3]


def _keep(solid: Manifold, turn: float, middle: np.ndarray, side: float) -> Manifold:
    normal = side * np.array([-np.sin(turn), np.cos(turn), 0.0])
    return solid.trim_by_plane(tuple(normal), float(normal @ middle))


def _cut(piece: Manifold, frame: np.ndarray, excess_m3: float, depth: int) -> list[Manifold]:
    """Make the radial, tangential or level cut that saves most hull volume, until the hull fits."""
    whole = piece.hull().volume()
    if depth == 0 or whole - piece.volume() <= excess_m3:
        return [piece]
    points = np.asarray(piece.to_mesh64().vert_properties)[:, :3]
    best: tuple[float, list[Manifold]] = (whole - 0.25 * excess_m3, [piece])
    for normal in frame:
        along = points @ normal
        for place in _PLACES:
            offset = float(along.min() + place * (along.max() - along.min()))
            halves = [half for half in piece.split_by_plane(tuple(normal), offset) if not half.is_empty()]
            volume = sum(half.hull().volume() for half in halves)
            if volume < best[0]:
                best = (volume, halves)
    if len(best[1]) == 1:
        return [piece]
    parts = [part for half in best[1] for part in half.decompose()]
    return [small for part in parts for small in _cut(part, frame, excess_m3, depth - 1)]


def join(hulls: list[Manifold], budget_m3: float, most: int) -> list[Manifold]:
    """Replace pairs of convex pieces by their common hull, cheapest first.

    Args:
        hulls: Convex pieces.
        budget_m3: Total volume that joins may add [m^3].
        most: Maximum number of pieces; joining continues beyond the budget until it is met.
    """
    pieces = dict(enumerate(hulls))
    costs: dict[tuple[int, int], tuple[float, Manifold]] = {}
    for one, other in combinations(pieces, 2):
        _price(costs, pieces, one, other)
    while costs:
        pair = min(costs, key=lambda key: (costs[key][0], key))
        added, both = costs[pair]
        if added > budget_m3 and len(pieces) <= most:
            break
        budget_m3 -= max(added, 0.0)
        costs = {key: cost for key, cost in costs.items() if not set(pair) & set(key)}
        for index in pair:
            del pieces[index]
        new = max(pieces, default=0) + len(hulls)
        pieces[new] = both
        for index in pieces:
            if index != new:
                _price(costs, pieces, index, new)
    return list(pieces.values())


def _price(
    costs: dict[tuple[int, int], tuple[float, Manifold]], pieces: dict[int, Manifold], one: int, other: int
) -> None:
    import manifold3d

    if _near(pieces[one], pieces[other]):
        both = manifold3d.Manifold.batch_hull([pieces[one], pieces[other]])
        costs[one, other] = (both.volume() - pieces[one].volume() - pieces[other].volume(), both)


def _near(one: Manifold, other: Manifold) -> bool:
    """Whether the bounding boxes touch; only neighbours are joined."""
    a, b = np.array(one.bounding_box()).reshape(2, 3), np.array(other.bounding_box()).reshape(2, 3)
    slack = 1e-4
    return bool((a[0] <= b[1] + slack).all() and (b[0] <= a[1] + slack).all())
