"""Pairs of pieces of one object that may touch: a lid lands on its base, overlapping pieces at a hinge do not.

Links of one object do not collide in general, because pieces of neighbouring links overlap around the joint. A pair of
pieces that does not overlap between the limits, or only meets face to face, may touch.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Asset
from dextera_build.geometry import kinematics, transforms

if TYPE_CHECKING:
    from manifold3d import Manifold

POSITIONS = 7
"""Number of positions of each joint tested between its limits."""
NEAR_M = 0.004
"""Pieces that never come closer than this need no contact [m]."""
DEEP_M = 0.0005
"""Overlaps deeper than this exclude a pair [m]."""


def pieces(asset: Asset) -> list[tuple[tuple[str, int], tuple[str, int]]]:
    """Pairs of (link, number of its collision piece) that may touch one another."""
    links = sorted(asset.body.links)
    if len(links) < 2:
        return []
    hulls = {name: [Piece(hull.vertices) for hull in asset.collision.links[name].hulls] for name in links}
    near: set[tuple[tuple[str, int], tuple[str, int]]] = set()
    deep: set[tuple[tuple[str, int], tuple[str, int]]] = set()
    for poses in _postures(asset):
        placed = {name: [piece.at(poses[name]) for piece in hulls[name]] for name in links}
        for number, one in enumerate(links):
            for other in links[number + 1 :]:
                for i, first in enumerate(placed[one]):
                    for j, second in enumerate(placed[other]):
                        pair = ((one, i), (other, j))
                        if pair in deep or not first.near(second):
                            continue
                        near.add(pair)
                        if first.overlap_m(second) > DEEP_M:
                            deep.add(pair)
    return sorted(near - deep)


def _postures(asset: Asset) -> Iterator[dict[str, np.ndarray]]:
    """Poses of the links with one joint at a time between its limits, the others as photographed."""
    yield kinematics.link_poses(asset.body)
    for joint in asset.body.joints:
        low, high = min(joint.lower, joint.position), max(joint.upper, joint.position)
        for position in np.linspace(low, high, POSITIONS):
            yield kinematics.link_poses(asset.body, {joint.name: float(position)})


class Piece:
    """A posed convex piece, by its corners (V, 3) [m]."""

    def __init__(self, vertices: np.ndarray) -> None:
        self._vertices = vertices.astype(np.float64)
        self._low, self._high = self._vertices.min(axis=0), self._vertices.max(axis=0)
        self._solid: Manifold | None = None

    def at(self, pose: np.ndarray) -> Piece:
        """The piece under a (4, 4) motion."""
        return Piece(transforms.apply(pose, self._vertices))

    def near(self, other: Piece) -> bool:
        """Whether the bounding boxes of both are close to one another."""
        return bool((self._low - NEAR_M < other._high).all() and (other._low - NEAR_M < self._high).all())

    def overlap_m(self, other: Piece) -> float:
        """Depth of the overlap along the axis with the least overlap [m]."""
        common = self.solid() ^ other.solid()
        if common.is_empty():
            return 0.0
        corners = np.asarray(common.to_mesh64().vert_properties)[:, :3]
        axes = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2]
        return float(np.ptp(corners @ axes.T, axis=0).min())

    def solid(self) -> Manifold:
        """The piece as a solid."""
        import manifold3d

        if self._solid is None:
            self._solid = manifold3d.Manifold.hull_points(self._vertices.tolist())
        return self._solid
