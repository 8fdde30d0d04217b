"""Probability that two groups of patches are one object, by a small network trained on drawn rooms.

`python -m tests.benchmarks.bonds` draws the rooms, trains the network, and writes `bond_weights.py`. Bonds join groups
that the rules of `grouping` left separate, and doubt what those rules would join. Across a depth step or a sharp crease
the threshold is higher: a step may separate two objects of one colour, and an upright part on a plate may be an object
on a tray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import regions

from . import bond_weights, relations
from .patches import SPAN, Surfaces
from .relations import Contact, Group

LEAST_MEETING = 0.1
"""Smallest fraction of a common border without a depth step at which two groups meet."""
SHARPEST_RAD = -0.5
"""Mean concave turn above which a crease is sharp [rad]."""
USUAL = 4.0
"""Number of standard deviations from the mean at which features are clipped."""
MARGIN_M = 0.003
"""Points this far outside an outline count as inside [m]."""
NAMES = (
    *("border", "pairs", "meeting", "convexity", "turn", "area", "larger_area", "lightness", "hue", "likeness"),
    *("bend", "larger_bend", "flatness", "larger_flatness", "top", "low", "own_low", "larger_low", "on_top"),
    *("normal", "upward", "larger_upward", "spread", "larger_spread", "inside", "around"),
    *("gap", "behind", "solidity", "own_solidity", "larger_solidity", "extent", "off_plane"),
    *("contrast", "outlined", "texture", "larger_texture", "aside", "width", "beside"),
)
"""The features of a pair, of its smaller group first."""


@dataclass(frozen=True)
class _Look:
    """Properties of one group that features need."""

    low_m: float  # 2 % quantile of the height
    points: np.ndarray  # (n, 2) a sample from above
    outline: np.ndarray  # (k, 2) corners of their convex outline; fewer than three if they lie on a line
    corners: np.ndarray  # (k, 2) corners of the convex outline in the picture: row, column
    away_m: float  # median distance from the camera
    low_high: np.ndarray  # (2, 3) 2 % and 98 % quantiles of the points [m]
    space: np.ndarray  # (n, 3) the sample
    normal: np.ndarray  # (3,) mean direction
    spread: float  # 1 minus the length of the mean normal
    noise_m: float
    colours: np.ndarray  # (5, 8, 8) see `relations.colours`
    texture: float  # mean difference of colour of pixels a border's width apart [CIE Lab]


class Bonds:
    """Scores of pairs of groups; identical groups are evaluated once."""

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._looks: dict[int, tuple[Group, _Look]] = {}

    def gentle(self, contact: Contact) -> bool:
        """Whether two groups meet, neither along a depth step nor in a sharp concave crease."""
        turn = contact.turn / max(contact.meeting, 1)
        return contact.meeting > LEAST_MEETING * contact.pairs and turn > SHARPEST_RAD

    def score(self, one: Group, other: Group, contact: Contact) -> float:
        """Log odds that two groups are one object."""
        values = (self.features(one, other, contact) - bond_weights.MEAN) / bond_weights.SCALE
        values = np.clip(values, -USUAL, USUAL)
        hidden = np.tanh(values @ bond_weights.FIRST + bond_weights.FIRST_BIAS)
        return float(hidden @ bond_weights.SECOND + bond_weights.SECOND_BIAS[0])

    def features(self, one: Group, other: Group, contact: Contact) -> np.ndarray:
        """Features (len(NAMES),) of a pair in any order; most are within -3 to 3."""
        small, large = sorted((one, other), key=lambda group: group.area_m2)
        a, b = self._look(small), self._look(large)
        colour = small.colour - large.colour
        return np.array(
            [
                *_of_border(small, contact),
                np.log10(max(small.area_m2, 1e-5)) + 3.0,
                np.log10(max(large.area_m2, 1e-5)) + 3.0,
                abs(float(colour[0])) / 30.0,
                float(np.linalg.norm(colour[1:])) / 20.0,
                float(np.minimum(a.colours, b.colours).sum()),
                *(float(np.clip(group.bend, -0.5, 0.5)) * 4.0 for group in (small, large)),
                *(min(group.flatness_m / look.noise_m, 5.0) / 2.0 for group, look in ((small, a), (large, b))),
                *(_bounded(height / 0.03) for height in (small.top_m - large.top_m, a.low_m - b.low_m)),
                *(float(np.clip(look.low_m / 0.03, 0.0, 3.0)) for look in (a, b)),
                _bounded((a.low_m - large.top_m) / 0.02),
                float(a.normal @ b.normal),
                *(abs(float(look.normal[2])) for look in (a, b)),
                *(look.spread for look in (a, b)),
                _inside(b.outline, a.points),
                _inside(a.outline, b.points),
                contact.step / max(contact.pairs, 1) / 0.02,
                _bounded((a.away_m - b.away_m) / 0.05),
                *_solidity(small, large, a, b),
                float(np.log10(max(_reach(a, b), 1e-3))) + 1.0,
                min(_off(large, a.space) / b.noise_m, 5.0) / 2.0,
                contact.contrast / max(contact.pairs, 1) / 20.0,
                contact.outlined / max(contact.pairs, 1),
                a.texture / 10.0,
                b.texture / 10.0,
                *_places(small, large, a, b),
            ]
        )

    def _look(self, group: Group) -> _Look:
        known = self._looks.get(id(group))
        if known is None or known[0] is not group:
            known = self._looks[id(group)] = (group, _look(self._surfaces, group))
        return known[1]


def _of_border(small: Group, contact: Contact) -> tuple[float, ...]:
    pairs = max(contact.pairs, 1)
    return (
        float(np.log1p(contact.pairs / np.sqrt(max(len(small.pixels), 1)))),
        float(np.log1p(contact.pairs)) / 3.0,
        contact.meeting / pairs,
        contact.convexity,
        float(np.clip(contact.turn / max(contact.meeting, 1), -1.5, 1.5)),
    )


def _look(s: Surfaces, group: Group) -> _Look:
    points = s.points.reshape(-1, 3)[group.pixels]
    sample = points[:: max(1, len(points) // 200)]
    places = np.stack(np.divmod(group.pixels, s.height.shape[1]), axis=1).astype(np.float64)
    normals = s.normal.reshape(-1, 3)[group.pixels]
    normals = normals[np.linalg.norm(normals, axis=1) > 0]
    mean = normals.mean(axis=0) if len(normals) else np.zeros(3)
    length = float(np.linalg.norm(mean))
    low = float(np.quantile(s.height.ravel()[group.pixels], 0.02))
    noise = relations.noise(s, group.pixels)
    return _Look(
        low_m=low,
        points=sample[:, :2],
        outline=regions.convex_hull(sample[:, :2]),
        corners=regions.convex_hull(places),
        away_m=float(np.median(np.linalg.norm(sample - s.eye, axis=1))),
        low_high=np.quantile(sample, (0.02, 0.98), axis=0),
        space=sample,
        normal=mean / max(length, 1e-9),
        spread=1.0 - length,
        noise_m=noise,
        colours=relations.colours(s, group),
        texture=_texture(s, places),
    )


def _texture(s: Surfaces, places: np.ndarray) -> float:
    rows, columns = places[:: max(1, len(places) // 400)].astype(int).T
    height, width = s.height.shape
    own: np.ndarray = np.zeros((height, width), bool)
    own[tuple(places.astype(int).T)] = True
    sums, count = 0.0, 0
    for down, right in ((0, 2 * SPAN), (2 * SPAN, 0)):
        far = np.minimum(rows + down, height - 1), np.minimum(columns + right, width - 1)
        same = own[far]
        sums += float(np.linalg.norm(s.lab[rows, columns] - s.lab[far], axis=-1)[same].sum())
        count += int(same.sum())
    return min(sums / max(count, 1), 30.0)


def _places(small: Group, large: Group, a: _Look, b: _Look) -> tuple[float, float, float]:
    """Distance of the middles from above, ratio of the widths, and common part of the heights of two groups."""
    middles = [look.low_high[:, :2].mean(axis=0) for look in (a, b)]
    widths = [max(float(np.linalg.norm(np.diff(look.low_high[:, :2], axis=0))), 1e-3) for look in (a, b)]
    aside = float(np.linalg.norm(middles[0] - middles[1])) / (0.5 * widths[1])
    both = min(small.top_m, large.top_m) - max(a.low_m, b.low_m)
    least = max(min(small.top_m - a.low_m, large.top_m - b.low_m), 1e-3)
    return (
        min(aside, 3.0),
        float(np.clip(np.log(widths[0] / widths[1]), -3.0, 3.0)),
        float(np.clip(both / least, -1.0, 1.0)),
    )


def _solidity(small: Group, large: Group, a: _Look, b: _Look) -> tuple[float, float, float]:
    """Covered fraction of the convex outline in the picture: of both groups together, and of each alone."""
    both = regions.convex_hull(np.concatenate([a.corners, b.corners]))
    shares = (
        (len(small.pixels) + len(large.pixels), both),
        (len(small.pixels), a.corners),
        (len(large.pixels), b.corners),
    )
    together, own, other = (min(1.0, count / max(float(_area(corners)), 1.0)) for count, corners in shares)
    return together, own, other


def _area(corners: np.ndarray) -> float:
    return abs(regions.area(corners)) if len(corners) > 2 else 0.0


def _reach(a: _Look, b: _Look) -> float:
    """Diagonal of the box around two groups, along the world's axes [m]."""
    low, high = np.minimum(a.low_high[0], b.low_high[0]), np.maximum(a.low_high[1], b.low_high[1])
    return float(np.linalg.norm(high - low))


def _off(large: Group, points: np.ndarray) -> float:
    """Root mean square distance of points (n, 3) from the larger group's plane [m]."""
    return float(np.sqrt(np.mean(np.square(points @ large.plane[0] + large.plane[1]))))


def _inside(outline: np.ndarray, points: np.ndarray) -> float:
    """Fraction of the points (n, 2) within a convex outline, with a tolerance of a few millimetres."""
    return float(regions.inside_convex(points, outline, MARGIN_M).mean()) if len(outline) > 2 else 0.0


def _bounded(value: float) -> float:
    return float(np.clip(value, -3.0, 3.0))
