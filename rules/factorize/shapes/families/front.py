"""The space that a body may fill: its seen surface and what is behind it, within the outline of its mask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.geometry import cameras, solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from .box import LARGEST_M

if TYPE_CHECKING:
    from manifold3d import CrossSection, Manifold

COARSE, FINE = 12, 48
"""Edges along the longer side of the outline: during the plane search, and in the result."""
MOST_FACES = 5500
SLACK_M = 0.0003
"""Initial tolerance of face reduction [m]; doubled until there are few enough faces."""
FOOT_M = 0.004
"""Height above its lowest point at which a floating body is cut before it is extended downwards [m]."""


@dataclass(frozen=True)
class Front:
    """The possibly full space: the seen surface and everything behind it, within the outline of the mask."""

    coarse: Manifold
    fine: Manifold

    def body(self, p: np.ndarray, *, fine: bool = False) -> Solid | None:
        """The largest body within that is symmetric about a plane, in the world frame; None if empty.

        Args:
            p: Direction of the plane's normal (from x to y, about z) [rad] and its distance from the origin [m].
            fine: Whether to keep the full detail of the view.
        """
        half = self.fine if fine else self.coarse
        normal = np.array([np.cos(p[0]), np.sin(p[0]), 0.0])
        mirror = np.concatenate([np.eye(3) - 2.0 * np.outer(normal, normal), 2.0 * p[1] * normal[:, None]], axis=1)
        whole = half ^ half.transform(mirror)
        parts = whole.decompose()
        if not parts:
            return None
        largest = _standing(max(parts, key=lambda part: float(part.volume())))
        return solids.from_manifold(_simplified(largest) if fine else largest)


def front_of(evidence: Evidence) -> Front | None:
    """The front of a view; None if its mask has no outline."""
    outline, mask = _outline(evidence)
    if outline is None:
        return None
    depth = _smooth_depth(evidence)
    longest = float(np.ptp(np.argwhere(mask), axis=0).max())
    coarse, fine = (_swept(outline, depth, evidence, longest / count) for count in (COARSE, FINE))
    return Front(coarse, fine)


def _outline(evidence: Evidence) -> tuple[CrossSection | None, np.ndarray]:
    """The mask as polygons [px] and as pixels; parts that may be occluded are filled up to the convex hull."""
    import cv2
    import manifold3d as m3

    mask = evidence.mask.astype(np.uint8)
    if not mask.any():
        return None, evidence.mask
    if not evidence.known.all():
        corners = cv2.convexHull(np.argwhere(mask)[:, ::-1].astype(np.int32))
        hull = cv2.fillConvexPoly(np.zeros_like(mask), corners, 1)
        mask |= hull & ~evidence.known
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [contour[:, 0].astype(np.float64) for contour in contours if len(contour) >= 12]
    if not rings:
        return None, evidence.mask
    section = m3.CrossSection(rings, m3.FillRule.EvenOdd)
    # Contours run through the centres of border pixels, half a pixel inside.
    return section.offset(0.5, m3.JoinType.Round).simplify(0.7), mask > 0


def _smooth_depth(evidence: Evidence) -> np.ndarray:
    """Smoothed depth (H, W) of the seen surface [m]; gaps take the nearest trusted depth."""
    from scipy import ndimage

    nearest = ndimage.distance_transform_edt(~evidence.core, return_distances=False, return_indices=True)
    filled = evidence.depth[nearest[0], nearest[1]]
    filled = ndimage.median_filter(filled, 5)
    return np.asarray(ndimage.gaussian_filter(filled, 1.5))


def _swept(outline: CrossSection, depth: np.ndarray, evidence: Evidence, edge_px: float) -> Manifold:
    """The solid above z = 0 swept from the seen surface far back along the lines of sight."""
    import manifold3d as m3
    from scipy import ndimage

    # A prism thinner than an edge is long: only its two ends are subdivided.
    thick = 0.5 * edge_px
    prism = m3.Manifold.extrude(outline.simplify(0.1 * edge_px), thick).refine_to_length(edge_px)

    def bend(corners: np.ndarray) -> np.ndarray:
        place = np.asarray(corners)
        seen = ndimage.map_coordinates(depth, place[:, 1::-1].T, order=1, mode="nearest")
        z = seen + (place[:, 2] / thick).round() * LARGEST_M
        point = cameras.directions(place[:, :2], evidence.k) * z[:, None]
        return np.asarray(transforms.apply(evidence.world_from_camera, point))

    swept = prism.warp_batch(bend).trim_by_plane((0.0, 0.0, 1.0), 0.0)
    return swept.simplify(SLACK_M)


def _standing(body: Manifold) -> Manifold:
    """The body, extended straight down to z = 0 if it floats."""
    import manifold3d as m3

    low = float(body.bounding_box()[2])
    if low < 1e-6:
        return body
    foot = body.slice(low + FOOT_M)
    if foot.is_empty():
        return body.translate((0.0, 0.0, -low))
    return body + m3.Manifold.extrude(foot, low + FOOT_M)


def _simplified(body: Manifold) -> Manifold:
    """The body with at most `MOST_FACES` faces."""
    slack = SLACK_M
    found = body.simplify(slack)
    while found.num_tri() > MOST_FACES and slack < 0.05:
        slack *= 2.0
        found = body.simplify(slack)
    return found
