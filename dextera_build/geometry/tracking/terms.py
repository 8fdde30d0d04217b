"""Terms of the least squares problem of one object: depth, outline and brightness.

Each gives rows of a Jacobian (N, 6 + J) for a twist of the pose and steps of the joints, residuals (N,) that the step
shall cancel, and weights (N,), the inverse of variances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, planes
from dextera_build.geometry.tracking.colours import Colours, bins
from dextera_build.geometry.tracking.frame import Frame
from dextera_build.geometry.tracking.model import Cast, Model, State

Rows = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Jacobian (N, 6 + J), residuals (N,), weights (N,)."""
SURFACE_M = 0.0015
"""Standard deviation of a mesh from the true surface, added to the noise of depth [m]."""
BESIDE_M = 0.02
"""Depth behind the outline from which a pixel cannot show the object, and before it from which it hides it [m]."""
GREY = 10.0
"""Standard deviation of brightness between two views of one place, 0..255."""


@dataclass(frozen=True)
class Spots:
    """Places on a model: points and normals (N, 3) of its links, with joints at 0."""

    points: np.ndarray
    normals: np.ndarray
    link: np.ndarray

    @classmethod
    def of(cls, cast: Cast, most: int) -> Spots:
        """Hits of a cast, thinned evenly to at most `most`, without those that are seen too obliquely."""
        chosen = np.flatnonzero(cast.drawn)
        chosen = chosen[:: max(1, -(-len(chosen) // most))]
        return cls.at(cast, chosen)

    @classmethod
    def at(cls, cast: Cast, chosen: np.ndarray) -> Spots:
        """Hits of a cast by their flat number (N,)."""
        points, normals = (each.reshape(-1, 3)[chosen].astype(np.float64) for each in (cast.points, cast.normals))
        return cls(points, normals, cast.link.reshape(-1)[chosen])


@dataclass(frozen=True)
class Placed:
    """Spots under a state."""

    points: np.ndarray  # (N, 3) camera frame [m]
    normals: np.ndarray  # (N, 3) camera frame
    motions: np.ndarray  # (N, 3, 6 + J) derivative of the points

    @classmethod
    def of(cls, model: Model, state: State, spots: Spots) -> Placed:
        """Where they are, and how they move."""
        links = state.pose @ model.link_poses(state.joints)
        if len(links) == 1:
            turn, shift = links[0, :3, :3], links[0, :3, 3]
            points, normals = spots.points @ turn.T + shift, spots.normals @ turn.T
        else:
            chosen = links[spots.link]
            points = np.einsum("nij,nj->ni", chosen[:, :3, :3], spots.points) + chosen[:, :3, 3]
            normals = np.einsum("nij,nj->ni", chosen[:, :3, :3], spots.normals)
        motions = np.zeros((len(points), 3, 6 + len(model.joints)))
        x, y, z = (points - state.pose[:3, 3]).T
        motions[:, 0, 0] = motions[:, 1, 1] = motions[:, 2, 2] = 1.0
        motions[:, 0, 4], motions[:, 0, 5] = z, -y
        motions[:, 1, 3], motions[:, 1, 5] = -z, x
        motions[:, 2, 3], motions[:, 2, 4] = y, -x
        for number, (axis, origin) in enumerate(_axes(model, state)):
            way = axis if model.joints[number].type == "prismatic" else np.cross(axis, points - origin)
            motions[:, :, 6 + number] = np.where(model.chains[spots.link, number][:, None], way, 0.0)
        return cls(points, normals, motions)


def _axes(model: Model, state: State) -> list[tuple[np.ndarray, np.ndarray]]:
    """Axis and a point on it of each joint, in the camera frame."""
    if not model.joints:
        return []
    names, poses = list(model.links), model.link_poses(state.joints)
    found = []
    for joint in model.joints:
        above = state.pose @ poses[names.index(joint.parent)]
        axis = above[:3, :3] @ np.asarray(joint.axis)
        found.append((axis / np.linalg.norm(axis), above[:3, :3] @ np.asarray(joint.origin) + above[:3, 3]))
    return found


def depth(frame: Frame, placed: Placed, gate_m: float, number: int) -> Rows:
    """Point-to-plane distances to the depth at the projected pixels (projective association).

    Points that something nearer hides, where nothing is within `gate_m`, or where another object than `number` was
    found, do not take part; Tukey's biweight.
    """
    rows, columns, inside = frame.nearest(placed.points)
    owner = frame.owner[rows, columns]
    inside &= (owner < 0) | (owner == number)
    seen = frame.measured(rows, columns)
    towards = placed.normals[:, 2] * -1.0
    off = (placed.normals * (seen - placed.points)).sum(axis=1)
    z = placed.points[:, 2]
    sigma = np.hypot(planes.depth_sigma(z) * np.abs(towards).clip(0.2), SURFACE_M)
    reach = gate_m + 2.0 * sigma
    along = np.abs(seen[:, 2] - z)
    fits = inside & (seen[:, 2] > 0) & (np.abs(off) < reach) & (along < 3.0 * reach)
    weight = np.square(1.0 - np.square(off / reach)) / np.square(sigma)
    jacobian = np.einsum("ni,nij->nj", placed.normals[fits], placed.motions[fits])
    return jacobian, off[fits], weight[fits]


def image_motion(frame: Frame, placed: Placed) -> np.ndarray:
    """Derivative (N, 2, 6 + J) of the pixels of points [px]."""
    x, y, z = placed.points.T
    fx, fy = frame.k[0, 0] / z, frame.k[1, 1] / z
    m = placed.motions
    right = fx[:, None] * (m[:, 0] - (x / z)[:, None] * m[:, 2])
    return np.stack([right, fy[:, None] * (m[:, 1] - (y / z)[:, None] * m[:, 2])], axis=1)


@dataclass(frozen=True)
class Outline:
    """Places on a model whose images are its outline, and where the outside is."""

    spots: Spots
    outward: np.ndarray  # (N, 2) unit directions in the picture, right and down
    beyond: float  # from a place to the outline [px]

    @classmethod
    def of(cls, cast: Cast, shape: tuple[int, int], most: int = 90) -> Outline:
        """Hits at the border of the drawn mask, without the border of the picture."""
        import cv2

        drawn = np.pad(cast.drawn, 1).astype(np.uint8)
        edge = (drawn - cv2.erode(drawn, np.ones((3, 3), np.uint8)))[1:-1, 1:-1] > 0
        soft = cv2.GaussianBlur(drawn.astype(np.float32), (5, 5), 1.2)
        out = np.stack([cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)], axis=-1)[1:-1, 1:-1]
        near = 2 * cast.stride
        edge[(cast.rows < near) | (cast.rows >= shape[0] - near)] = False
        edge[:, (cast.columns < near) | (cast.columns >= shape[1] - near)] = False
        chosen = np.flatnonzero(edge & (np.abs(out).sum(axis=-1) > 1e-3))
        chosen = chosen[:: max(1, -(-len(chosen) // most))]
        way = -out.reshape(-1, 2)[chosen]
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        return cls(Spots.at(cast, chosen), way, 0.5 * cast.stride)


@dataclass(frozen=True)
class Seen:
    """Where the picture shows the outline: offsets (N,) outward and their standard deviations [px]; NaN if hidden."""

    offset: np.ndarray
    sigma: np.ndarray


def seek(frame: Frame, placed: Placed, outline: Outline, colours: Colours, reach_px: int) -> Seen:
    """Look along the normals of an outline for the step from the object to its surroundings.

    The posterior of the step's place given the colours (Stoiber et al. 2022, region modality) and the depth: what is
    clearly behind is not the object; a line along which something nearer is seen tells nothing.
    """
    steps = np.arange(-reach_px, reach_px + 1)
    middle = cameras.project(placed.points, frame.k) + outline.beyond * outline.outward
    at = np.round(middle[:, None] + steps[:, None] * outline.outward[:, None]).astype(np.int64)
    height, width = frame.shape
    inside = ((at >= 0) & (at < (width, height))).all(axis=(1, 2))
    column, row = at[..., 0].clip(0, width - 1), at[..., 1].clip(0, height - 1)
    evidence = colours.odds()[bins(frame.rgb[row, column])]
    z, own = frame.depth[row, column], placed.points[:, 2:3]
    evidence = np.where((z > own + BESIDE_M), -3.0, evidence)
    hidden = ((z > 0) & (z < own - BESIDE_M)).mean(axis=1) > 0.2
    total = np.cumsum(evidence, axis=1)
    # If the step lies after sample i, those up to i are the object; neighbours are not independent.
    belief = np.exp(0.7 * (total - total.max(axis=1, keepdims=True)))
    belief /= belief.sum(axis=1, keepdims=True)
    places = steps + 0.5
    offset = belief @ places
    sigma = np.sqrt(np.maximum(belief @ np.square(places) - np.square(offset), 0.0))
    return Seen(np.where(inside & ~hidden, offset, np.nan), sigma)


def outline(frame: Frame, placed: Placed, edge: Outline, seen: Seen) -> Rows:
    """Distances of the outline along its normals [px]."""
    known = np.isfinite(seen.offset)
    jacobian = np.einsum("nk,nkj->nj", edge.outward[known], image_motion(frame, placed)[known])
    spread = np.square(seen.sigma[known]) + 1.5**2
    off = seen.offset[known]
    # Lines to something else of the object's colour pull with bounded force (Huber).
    weight = 1.0 / spread * np.minimum(1.0, 3.0 / np.maximum(np.abs(off), 1e-9))
    return jacobian, off, weight


@dataclass(frozen=True)
class Look:
    """How an object looked once: places on it, and their brightness."""

    spots: Spots
    grey: np.ndarray  # (N,) 0..255
    towards: np.ndarray  # (3,) direction to the camera in the object frame


def brightness(frame: Frame, placed: Placed, look: Look) -> tuple[Rows, float]:
    """Differences of brightness to an earlier view, up to a gain and an offset, and the correlation with it."""
    rows, columns, inside = frame.nearest(placed.points)
    z = frame.depth[rows, columns]
    own = placed.points[:, 2]
    facing = (placed.normals * placed.points).sum(axis=1) < -0.2 * np.linalg.norm(placed.points, axis=1)
    fits = inside & facing & ((z == 0) | (np.abs(z - own) < 0.015))
    size = placed.motions.shape[2]
    if fits.sum() < 20:
        return (np.zeros((0, size)), np.zeros(0), np.zeros(0)), np.nan
    rows, columns = rows[fits], columns[fits]
    now, then = frame.smooth[rows, columns].astype(np.float64), look.grey[fits]
    spread_now, spread_then = now.std(), then.std()
    score = float(((now - now.mean()) * (then - then.mean())).mean() / max(spread_now * spread_then, 1e-9))
    gain = np.clip(spread_now / max(spread_then, 1.0), 0.4, 2.5)
    off = gain * (then - then.mean()) + np.median(now - gain * (then - then.mean())) - now
    slope = np.stack([each[rows, columns] for each in frame.slopes], axis=1).astype(np.float64)
    # A subpixel correction: the brightness was taken at the nearest pixel.
    exact = cameras.project(placed.points[fits], frame.k) - np.stack([columns, rows], axis=1)
    off -= (slope * exact).sum(axis=1)
    jacobian = np.einsum("nk,nkj->nj", slope, image_motion(frame, placed)[fits])
    weight = np.minimum(1.0, 1.5 * GREY / np.maximum(np.abs(off), 1e-9)) / GREY**2
    return (jacobian, off, weight), score if min(spread_now, spread_then) > 4.0 else np.nan
