"""Removal of overlaps between the collision pieces of neighbours, whose unseen sides are guesses.

A simulator pushes overlapping bodies apart, away from their photographed poses. Therefore one of them is cut back to
the surface of the other: the one that loses the smaller fraction of its volume. Its visual geometry and mass properties
are kept. Every convex piece is cut by one plane, the one among the faces of both pieces with the least overlap (the
separating axes of Gottschalk, Lin and Manocha 1996, without those of two edges), so it stays convex. A body that would
lose too much is not cut: one of them is then part of the other, or a false detection.

Undersides are never visible. A body that hovers above the support, without a lower body nearby, gets feet that reach
down to the support: wheels in the shadow of a bus are as high as 20 mm, and nobody sees them. A body above another one
or above a level of the static scene, whose foot the photograph hides, gets feet that reach down to that one, each
corner by its own gap: a can in a bowl then stands on the bowl's floor.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.geometry import kinematics, transforms
from dextera_build.geometry.convex import Convex
from dextera_build.sim.model import footing

TOUCH_M = 0.0002
"""Overlaps up to this depth are contacts [m]."""
MOST_LOST = 0.3
"""Maximum fraction of the volume of a body's pieces that may be cut away."""
HOVER_M, ALONE_M = (0.002, 0.03), 0.005
"""A body at such a height above the support, and farther than the second distance from every lower body, gets feet [m]:
a smaller gap causes no relevant fall, and what is higher hangs or stands on something hidden."""
UNDERSIDE_M = 0.006
"""Corners up to this height above the lowest one get feet [m]."""
OVER = 0.5
"""Least fraction of the corners of an underside that are above what carries it."""


@dataclass(frozen=True)
class Cut:
    """Record of a cut."""

    body: str
    """Label of the body that was cut back."""
    by: str
    """Label of its neighbour; "" for the static scene."""
    deep_m: float
    """Largest overlap of two pieces, along their axis of least overlap [m]."""
    lost: float
    """Lost fraction of the volume of its pieces."""


@dataclass(frozen=True)
class Parted:
    """Assets whose collision pieces neither overlap nor hover."""

    assets: dict[str, Asset]
    cuts: tuple[Cut, ...]
    feet: dict[str, float]
    """Label -> height at which the body hovered above what carries it [m]."""


def parted(assets: Mapping[str, Asset], static: Sequence[np.ndarray]) -> Parted:
    """The assets with collision pieces that do not overlap; unchanged where nothing overlaps or hovers.

    Args:
        assets: Label -> asset in the pose and with the joint positions of the photograph; the support is z = 0.
        static: Convex pieces of the static scene by their corners (V, 3) [m]; they are never cut.
    """
    bodies = {label: _Body.of(asset) for label, asset in sorted(assets.items())}
    room = [Convex(corners) for corners in static]
    feet, cuts = {}, []
    for label, body in sorted(bodies.items(), key=lambda each: float(each[1].low[2])):
        others = [other for other in bodies.values() if other is not body]
        if gap := body.stand(others, room):
            feet[label] = gap
    for label, body in bodies.items():
        if tried := body.cut_by(room):
            cuts.append(body.take(tried, label, ""))
    labels = list(bodies)
    for number, first in enumerate(labels):
        for second in labels[number + 1 :]:
            one, other = bodies[first], bodies[second]
            if not one.near(other, 0.0):
                continue
            tries = [(one, one.cut_by(other.all()), first, second), (other, other.cut_by(one.all()), second, first)]
            allowed = [(body, tried, own, by) for body, tried, own, by in tries if tried is not None]
            if allowed:
                body, tried, own, by = min(allowed, key=lambda each: each[1].lost)
                cuts.append(body.take(tried, own, by))
    changed = {label: bodies[label].cut_asset(asset) for label, asset in assets.items()}
    return Parted(changed, tuple(cuts), feet)


@dataclass(frozen=True)
class _Try:
    """A body with a tentative cut."""

    links: dict[str, list[Convex | None]]
    deep_m: float
    lost: float


@dataclass
class _Body:
    """The pieces of one asset in the world."""

    links: dict[str, list[Convex | None]]
    """Link -> its pieces; None for one that was cut away."""
    poses: dict[str, np.ndarray]
    """Link -> T_world_object of its pieces."""
    volume: float
    """Initial volume of all pieces [m^3]."""
    changed: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, asset: Asset) -> _Body:
        poses = {name: asset.pose.matrix @ pose for name, pose in kinematics.link_poses(asset.body).items()}
        links: dict[str, list[Convex | None]] = {
            name: [Convex(transforms.apply(poses[name], hull.vertices.astype(np.float64))) for hull in pieces.hulls]
            for name, pieces in asset.collision.links.items()
        }
        return cls(links, poses, 0.0)

    def all(self) -> list[Convex]:
        """Every remaining piece."""
        return [piece for pieces in self.links.values() for piece in pieces if piece is not None]

    @property
    def low(self) -> np.ndarray:
        """Lower corner (3,) of the box around it [m]."""
        return np.asarray(np.min([piece.low for piece in self.all()], axis=0))

    @property
    def high(self) -> np.ndarray:
        """Upper corner (3,) of the box around it [m]."""
        return np.asarray(np.max([piece.high for piece in self.all()], axis=0))

    def is_alone(self, bodies: Sequence[_Body], room: Sequence[Convex]) -> bool:
        """Whether nothing that reaches lower than its underside, and above the support, is near."""
        lower: list[_Body | Convex] = [other for other in bodies if other.low[2] < self.low[2]]
        lower += [piece for piece in room if piece.high[2] > HOVER_M[0]]
        return not any(self.near(other, ALONE_M) for other in lower)

    def near(self, other: _Body | Convex, gap: float) -> bool:
        """Whether the bounding boxes are closer than `gap` [m]."""
        return bool((self.low - gap < other.high).all() and (other.low - gap < self.high).all())

    def stand(self, others: Sequence[_Body], room: Sequence[Convex]) -> float:
        """Extend the underside down to what carries it, and return the largest gap; 0 if it stands, or nothing does."""
        low = float(self.low[2])
        limit = low + UNDERSIDE_M
        under = [piece.corners[piece.corners[:, 2] <= limit] for piece in self.all()]
        corners = np.concatenate(under)
        floor = np.zeros(len(corners))
        if not (HOVER_M[0] < low <= HOVER_M[1] and self.is_alone(others, room)):
            near = [piece for other in others if other.near(self, HOVER_M[1]) for piece in other.all()]
            floor = footing.floor(corners, [*near, *room], UNDERSIDE_M)
            gaps = corners[:, 2] - floor
            if np.mean(floor > HOVER_M[0]) < OVER or footing.carry(corners, gaps <= HOVER_M[0]):
                return 0.0
        gaps = corners[:, 2] - floor
        reached = (gaps > HOVER_M[0]) & (gaps <= HOVER_M[1])
        feet = np.column_stack([corners[:, :2], floor])[reached]
        if not len(feet):
            return 0.0
        number = np.repeat(np.arange(len(under)), [len(each) for each in under])[reached]
        counted = 0
        for name, pieces in self.links.items():
            for place, piece in enumerate(pieces):
                if piece is None:
                    continue
                own = feet[number == counted]
                counted += 1
                if len(own):
                    pieces[place] = Convex(np.concatenate([piece.corners, own]))
                    self.changed.add(name)
        return float(gaps[reached].max())

    def cut_by(self, others: Iterable[Convex]) -> _Try | None:
        """The body without its overlap with `others`; None if nothing or too much would be cut."""
        others = list(others)
        deepest, links = 0.0, {}
        for name, pieces in self.links.items():
            links[name] = [None if piece is None else _cut(piece, others) for piece in pieces]
            deepest = max([deepest, *(cut[1] for cut in links[name] if cut is not None)])
        if deepest <= TOUCH_M:
            return None
        left = {name: [None if cut is None else cut[0] for cut in cuts] for name, cuts in links.items()}
        self.volume = self.volume or sum(piece.volume for piece in self.all())
        rest = sum(piece.volume for pieces in left.values() for piece in pieces if piece is not None)
        lost = 1.0 - rest / max(self.volume, 1e-12)
        if lost > MOST_LOST or not all(any(piece is not None for piece in pieces) for pieces in left.values()):
            return None
        return _Try(left, deepest, lost)

    def take(self, tried: _Try, own: str, by: str) -> Cut:
        """Apply a cut."""
        self.changed |= {name for name, pieces in tried.links.items() if pieces != self.links[name]}
        self.links = tried.links
        return Cut(own, by, tried.deep_m, tried.lost)

    def cut_asset(self, asset: Asset) -> Asset:
        """The asset with these pieces; pieces that were not cut are unchanged to the bit."""
        if not self.changed:
            return asset
        links = dict(asset.collision.links)
        for name in self.changed:
            back = np.linalg.inv(self.poses[name])
            left = [transforms.apply(back, piece.corners) for piece in self.links[name] if piece is not None]
            hulls = [Hull(vertices=corners.astype(np.float32)) for corners in left]
            links[name] = links[name].model_copy(update={"hulls": tuple(hulls)})
        return asset.model_copy(update={"collision": asset.collision.model_copy(update={"links": links})})


def _cut(piece: Convex, others: Sequence[Convex]) -> tuple[Convex | None, float]:
    """The remainder of a piece next to others, and its deepest overlap with one of them [m]."""
    deepest = 0.0
    for other in others:
        deep, normal, end = piece.overlap(other)
        if deep > TOUCH_M:
            deepest = max(deepest, deep)
            left = piece.beyond(normal, end)
            if left is None:
                return None, deepest
            piece = left
    return piece, deepest
