"""A handle on a revolved body: the part of the mask next to the body, as a solid in the vertical plane of the root."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dextera_build.geometry import cameras, raycast, solids, transforms
from dextera_build.geometry.solids import Solid

from .evidence import Evidence
from .hypotheses import Finished

LEAST_PART = 0.012
"""Smallest fraction of the mask that a handle covers."""
ROOT_M = 0.0012
"""Depth of a handle's roots inside the wall [m], the minimum wall thickness."""
INDEPENDENT = 4.0
"""Effective number of independent depths in the picture of a handle; errors of neighbours are correlated."""
UNKNOWN_TURN_RAD = 0.5
"""Standard deviation of the azimuth of a handle seen without depth [rad]."""
WEDGES = 8
"""Number of convex pieces of a handle's loop."""
LAYERS = ((1.0, 0.26), (0.86, 0.1), (0.62, 0.0))
"""Fractions of the half thickness, and of the strap's width by which the outline is inset there, for rounded edges."""


@dataclass(frozen=True)
class _Plane:
    """The vertical half plane of the handle, in the body's frame."""

    azimuth: float
    eye: np.ndarray  # (3,) camera position
    object_from_camera: np.ndarray

    def place(self, pixels: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(distance from the axis, height) (N, 2) [m] and depth (N,) at which rays through (column, row) cross it."""
        bearing = cameras.directions(pixels, k) @ self.object_from_camera[:3, :3].T
        normal = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        depth = -(self.eye @ normal) / (bearing @ normal)
        points = self.eye + depth[:, None] * bearing
        out = points[:, 0] * np.cos(self.azimuth) + points[:, 1] * np.sin(self.azimuth)
        return np.stack([out, points[:, 2]], axis=-1), depth

    def slide(self, pixels: np.ndarray, k: np.ndarray) -> np.ndarray:
        """Mean shift (2,) on the plane of points seen along rays (N, 2), per metre of distance from the plane."""
        bearing = cameras.directions(pixels, k) @ self.object_from_camera[:3, :3].T
        normal = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        off = normal - bearing / (bearing @ normal)[:, None]
        out = off[:, 0] * np.cos(self.azimuth) + off[:, 1] * np.sin(self.azimuth)
        return np.array([out.mean(), off[:, 2].mean()])


def with_handle(body: Finished, evidence: Evidence) -> Finished | None:
    """Add the handle that the mask shows, or return None without one."""
    outer = body.outside or body.solid
    beside, shown = _beside(outer.moved(body.pose), evidence)
    if beside is None:
        return None
    found = _plane(beside, body.pose, evidence)
    if found is None:
        return None
    plane, turn_sigma = found
    outlines = _outlines(beside, shown, plane, evidence, outer)
    if outlines is None:
        return None
    section, width, thickness = outlines
    loop = _thickened(section, width, thickness, plane.azimuth)
    whole = solids.largest(solids.union([body.solid, loop]))
    if whole.volume < 1.005 * body.solid.volume:
        return None
    walls = body.walls and (*body.walls, *_wedges(section, thickness, plane.azimuth))
    # The depth is that of the strap's near side, half its thickness before the plane in which it is built.
    aside = thickness / 2.0 / max(sum(section.bounds()[::2]) / 2.0, thickness)
    return replace(body, solid=whole, walls=walls, turn_sigma=float(np.hypot(turn_sigma, aside)))


def _beside(outer: Solid, evidence: Evidence) -> tuple[np.ndarray | None, np.ndarray]:
    """The largest patch of the mask next to the body, and the body's own silhouette."""
    from scipy import ndimage

    height, width = evidence.mask.shape
    shown = raycast.render(
        [raycast.Surface(outer.vertices, outer.faces)], evidence.k, evidence.world_from_camera, height, width
    )
    covered = shown.index >= 0
    rest = evidence.mask & evidence.known & ~ndimage.binary_dilation(covered, iterations=2)
    # Thin straps break up in a mask; join pieces a few pixels apart.
    joined = ndimage.binary_closing(ndimage.binary_opening(rest), iterations=4) & ~covered
    labels, number = ndimage.label(joined)
    if number == 0:
        return None, covered
    sizes = np.bincount(labels.ravel())[1:]
    if sizes.max() < max(LEAST_PART * evidence.mask.sum(), 40):
        return None, covered
    patch = labels == int(np.argmax(sizes)) + 1
    # Restore the contact with the body that the dilation removed.
    near = ndimage.binary_dilation(patch, iterations=3) & evidence.mask & ~covered
    return patch | near, covered


def _plane(beside: np.ndarray, pose: np.ndarray, evidence: Evidence) -> tuple[_Plane, float] | None:
    """The half plane whose intersection with the rays best matches the seen depth of the handle.

    The second value is the standard deviation of its azimuth [rad] over all almost equally good planes.
    """
    from scipy import ndimage

    object_from_camera = transforms.invert(pose) @ evidence.world_from_camera
    eye = object_from_camera[:3, 3]
    if not (evidence.depth > 0).any():
        return _Plane(_sideways(beside, pose, evidence), eye, object_from_camera), UNKNOWN_TURN_RAD
    inner = ndimage.binary_erosion(beside, iterations=1) & (evidence.depth > 0)
    rows, columns = np.nonzero(inner)
    if len(rows) < 12:
        return None
    pixels = np.stack([columns, rows], axis=-1).astype(np.float64)
    points = transforms.apply(object_from_camera, evidence.camera_points(inner))
    middle = np.median(points, axis=0)
    guess = float(np.arctan2(middle[1], middle[0]))
    best, least = None, np.inf
    turns, errors = [], []
    for turn in np.deg2rad(np.arange(-40.0, 41.0, 2.0)):
        plane = _Plane(guess + turn, eye, object_from_camera)
        place, depth = plane.place(pixels, evidence.k)
        error = float(np.median(np.abs(depth - evidence.depth[inner])))
        # Viewed nearly edge-on, a pixel does not locate a point on the plane.
        slant = abs(np.sin(plane.azimuth - np.arctan2(-eye[1], -eye[0])))
        if slant <= 0.25 or np.median(place[:, 0]) <= 0:
            continue
        turns.append(turn)
        errors.append(error)
        if error < least:
            best, least = plane, error
    if best is None:
        return None
    excess = (np.square(errors) - least**2) / np.median(evidence.sigma[inner]) ** 2
    weights = np.exp(-0.5 * INDEPENDENT * excess)
    return best, float(np.sqrt(np.average(np.square(np.array(turns) - (best.azimuth - guess)), weights=weights)))


def _sideways(beside: np.ndarray, pose: np.ndarray, evidence: Evidence) -> float:
    """Azimuth of a handle at a right angle to the view, on the side of the body where it is seen [rad]."""
    origin = transforms.invert(evidence.world_from_camera) @ pose[:, 3]
    axis = evidence.k[0, 0] * origin[0] / origin[2] + evidence.k[0, 2]
    away = (pose[:3, 3] - evidence.eye) @ pose[:3, :3]
    right = float(np.arctan2(-away[0], away[1]))
    return right if float(np.nonzero(beside)[1].mean()) > axis else right + np.pi


def _outlines(
    beside: np.ndarray, covered: np.ndarray, plane: _Plane, evidence: Evidence, outer: Solid
) -> tuple[Any, float, float] | None:
    """Cross-section (distance from the axis, height) with roots in the wall, strap width and sideways thickness [m]."""
    import cv2
    import manifold3d as m3
    from scipy import ndimage

    contours, _ = cv2.findContours(beside.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [
        plane.place(ndimage.gaussian_filter1d(c[:, 0].astype(np.float64), 1.5, axis=0, mode="wrap"), evidence.k)[0]
        for c in contours
        if len(c) >= 12
    ]
    if not rings:
        return None
    section = m3.CrossSection(rings, m3.FillRule.EvenOdd)
    scale = abs(section.area()) / max(np.count_nonzero(beside), 1)
    inside = ndimage.distance_transform_edt(beside)
    width = 2.0 * float(np.quantile(inside[inside > 0], 0.9)) * float(np.sqrt(scale))
    section, thickness = _without_side(section, width, plane, beside, evidence)
    radius_at = _radii(outer)
    touching = beside & ndimage.binary_dilation(covered, iterations=4)
    labels, number = ndimage.label(touching, structure=np.ones((3, 3)))
    roots = []
    for label in range(1, number + 1):
        rows, columns = np.nonzero(labels == label)
        place, _ = plane.place(np.stack([columns, rows], axis=-1).astype(np.float64), evidence.k)
        low, high = np.quantile(place[:, 1], [0.03, 0.97])
        if len(rows) >= 6:
            roots.append((float(low), float(high), float(np.quantile(place[:, 0], 0.9))))
    if len(roots) == 1:
        roots.append(_other_end(section, roots[0], width))
    for low, high, end in roots:
        wall = [radius_at(z) - ROOT_M for z in (low, high)]
        if min(wall) < end:
            section = section + m3.CrossSection([np.array([[wall[0], low], [end, low], [end, high], [wall[1], high]])])
    section = section.offset(0.0008, m3.JoinType.Round).offset(-0.0008, m3.JoinType.Round).simplify(0.0003)
    return section, width, thickness


def _without_side(
    section: Any, width: float, plane: _Plane, beside: np.ndarray, evidence: Evidence
) -> tuple[Any, float]:
    """The section without the silhouette of the strap's side, and the side's likely thickness [m]."""
    rows, columns = np.nonzero(beside)
    middle = np.array([[columns.mean(), rows.mean()]])
    shift = plane.slide(middle, evidence.k)
    thickness = float(np.clip(1.2 * width / (1.0 + 0.8 * np.linalg.norm(shift)), 0.005, 0.02))
    half = shift * thickness / 2
    lean = section ^ section.translate(tuple(half)) ^ section.translate(tuple(-half))
    return (lean, thickness) if lean.area() > 0.35 * section.area() else (section, thickness)


def _other_end(section: Any, root: tuple[float, float, float], width: float) -> tuple[float, float, float]:
    """A second root (low, high, end), level with the far tip, for a strap seen to meet the body only once."""
    corners = np.concatenate([np.asarray(ring) for ring in section.to_polygons()])
    tip = corners[np.argmax(np.abs(corners[:, 1] - (root[0] + root[1]) / 2))]
    low = tip[1] - width if tip[1] > root[1] else tip[1]
    return float(low), float(low + width), float(tip[0]) - 0.2 * width


def _radii(outer: Solid) -> Callable[[float], float]:
    """Function from height to radius of a revolved body."""
    radius = np.linalg.norm(outer.vertices[:, :2], axis=1)
    side = radius > 0.3 * radius.max()
    heights = np.unique(np.round(outer.vertices[side, 2], 6))
    widest = np.array([radius[np.abs(outer.vertices[:, 2] - z) < 2e-6].max() for z in heights])
    return lambda z: float(np.interp(z, heights, widest))


def _thickened(section: Any, width: float, thickness: float, azimuth: float) -> Solid:
    parts = []
    for part, inset in LAYERS:
        drawn = section.offset(-inset * width) if inset else section
        rings = [np.asarray(ring) for ring in drawn.to_polygons()]
        if rings:
            half = part * thickness / 2
            parts.append(solids.extrude_rings(rings, -half, half))
    return _upright(solids.union(parts), azimuth)


def _wedges(section: Any, thickness: float, azimuth: float) -> tuple[np.ndarray, ...]:
    """Corner points of the handle's convex pieces: its section cut into wedges about its centre."""
    import manifold3d as m3

    left, low, right, high = section.bounds()
    middle, reach = np.array([left, (low + high) / 2]), 2.0 * (right - left + high - low)
    pieces = []
    turns = np.linspace(-np.pi / 2, np.pi / 2, WEDGES + 1)
    for start, end in pairwise(turns):
        arms = [middle + reach * np.array([np.cos(turn), np.sin(turn)]) for turn in (start, end)]
        cut = section ^ m3.CrossSection([np.array([middle, *arms])])
        for part in cut.decompose():
            if part.area() > 1e-6:
                corners = np.concatenate([np.asarray(ring) for ring in part.to_polygons()])
                flat = np.concatenate([np.c_[corners, np.full(len(corners), s * thickness / 2)] for s in (-1, 1)])
                pieces.append(_upright(Solid(flat, np.zeros((0, 3), np.int64)), azimuth).vertices)
    return tuple(pieces)


def _upright(flat: Solid, azimuth: float) -> Solid:
    """Map (distance, height, sideways) to the body's frame, with the half plane at `azimuth`."""
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    rotation = np.array([[cosine, 0.0, sine], [sine, 0.0, -cosine], [0.0, 1.0, 0.0]])
    return Solid(flat.vertices @ rotation.T, flat.faces)
