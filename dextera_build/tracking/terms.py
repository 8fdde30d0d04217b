"""Terms of the least squares problem of one object: depth and brightness; `outline` has the third."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import cameras, least_squares, lie, planes
from dextera_build.tracking.frame import Frame
from dextera_build.tracking.model import Cast, Model, State

DEPTH_NOISE = 0.7
"""Noise of depth relative to that of a structured-light camera at the same distance."""
NEIGHBOURS = 1.25
"""Correlation of mesh errors between neighbouring patches, as a factor on these errors."""
STEP_M = 0.0001
"""Standard deviation of a persistent error of depth: quantisation, and use of the nearest pixel [m]."""
GREY_NOISE, GREY_LASTING = 3.2, 3.0
"""Standard deviation of brightness between two views: noise, and changed lighting, common to a patch."""
GREY = 10.0
"""Standard deviation of brightness between two views of one point, for its weight relative to other terms, 0..255."""


@dataclass(frozen=True)
class Rows:
    """Rows of one term, in its own unit: m, px, or brightness 0..255."""

    jacobian: np.ndarray  # (N, 6 + J) for a twist of the pose and steps of the joints
    off: np.ndarray  # (N,) residuals that the step is to cancel
    weight: np.ndarray  # (N,) inverse of variances
    noise: np.ndarray  # (N,) standard deviation of the noise that is independent between frames
    lasting: np.ndarray  # (N, K) of K persistent errors, such as those of the mesh, common within a patch
    patch: np.ndarray  # (N,) int, part of the surface


@dataclass(frozen=True)
class Spots:
    """Points of a model: points and normals (N, 3) of its links, with joints at 0."""

    points: np.ndarray
    normals: np.ndarray
    link: np.ndarray

    @classmethod
    def of(cls, cast: Cast, most: int) -> Spots:
        """Hits of a cast, subsampled evenly to at most `most`, without grazing ones."""
        chosen = np.flatnonzero(cast.drawn)
        chosen = chosen[:: max(1, -(-len(chosen) // most))]
        return cls.at(cast, chosen)

    @classmethod
    def at(cls, cast: Cast, chosen: np.ndarray) -> Spots:
        """Hits of a cast by their flat index (N,)."""
        points, normals = (each.reshape(-1, 3)[chosen].astype(np.float64) for each in (cast.points, cast.normals))
        return cls(points, normals, cast.link.reshape(-1)[chosen])


@dataclass(frozen=True)
class Placed:
    """Points of a model at a state."""

    points: np.ndarray  # (N, 3) camera frame [m]
    normals: np.ndarray  # (N, 3) camera frame
    motions: np.ndarray  # (N, 3, 6 + J) derivative of the points
    patch: np.ndarray  # (N,) int, octant of the object and link
    surface_m: float  # standard deviation of the mesh from the true surface [m]

    @classmethod
    def of(cls, model: Model, state: State, spots: Spots) -> Placed:
        """Their positions and derivatives."""
        links = state.pose @ model.link_poses(state.joints)
        if len(links) == 1:
            turn, shift = links[0, :3, :3], links[0, :3, 3]
            points, normals = spots.points @ turn.T + shift, spots.normals @ turn.T
        else:
            chosen = links[spots.link]
            points = np.einsum("nij,nj->ni", chosen[:, :3, :3], spots.points) + chosen[:, :3, 3]
            normals = np.einsum("nij,nj->ni", chosen[:, :3, :3], spots.normals)
        motions = np.zeros((len(points), 3, 6 + len(model.joints)))
        motions[:, :, :6] = lie.point_motions(points - state.pose[:3, 3])[:, :, :6]
        for number, (axis, origin) in enumerate(_axes(model, state)):
            way = axis if model.joints[number].type == "prismatic" else np.cross(axis, points - origin)
            motions[:, :, 6 + number] = np.where(model.chains[spots.link, number][:, None], way, 0.0)
        octant = (spots.points > model.centre) @ np.array([1, 2, 4])
        return cls(points, normals, motions, octant + 8 * spots.link, model.mesh_sigma_m)


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

    Occluded points, points without a measurement within `gate_m`, and pixels of another object than `number` are
    ignored; weights are Tukey's biweight.
    """
    rows, columns, inside = frame.nearest(placed.points)
    inside &= ~frame.others(rows, columns, number)
    seen = frame.measured(rows, columns)
    towards = placed.normals[:, 2] * -1.0
    off = (placed.normals * (seen - placed.points)).sum(axis=1)
    z = placed.points[:, 2]
    noise = planes.depth_sigma(z) * np.abs(towards).clip(0.2)
    sigma = np.hypot(noise, placed.surface_m)
    reach = gate_m + 2.0 * sigma
    along = np.abs(seen[:, 2] - z)
    fits = inside & (seen[:, 2] > 0) & (np.abs(off) < reach) & (along < 3.0 * reach)
    weight = least_squares.tukey(off, reach) / np.square(sigma)
    jacobian = np.einsum("ni,nij->nj", placed.normals[fits], placed.motions[fits])
    lasting = np.full((int(fits.sum()), 1), np.hypot(NEIGHBOURS * placed.surface_m, STEP_M))
    return Rows(jacobian, off[fits], weight[fits], DEPTH_NOISE * noise[fits], lasting, placed.patch[fits])


def image_motion(frame: Frame, placed: Placed) -> np.ndarray:
    """Derivative (N, 2, 6 + J) of the pixels of points [px]."""
    x, y, z = placed.points.T
    fx, fy = frame.k[0, 0] / z, frame.k[1, 1] / z
    m = placed.motions
    right = fx[:, None] * (m[:, 0] - (x / z)[:, None] * m[:, 2])
    return np.stack([right, fy[:, None] * (m[:, 1] - (y / z)[:, None] * m[:, 2])], axis=1)


@dataclass(frozen=True)
class Look:
    """Stored view of an object: points on it, and their brightness."""

    spots: Spots
    grey: np.ndarray  # (N,) 0..255
    towards: np.ndarray  # (3,) direction to the camera in the object frame
    turn: np.ndarray  # (3, 3) R_camera_object of that view
    covariance: np.ndarray  # (6, 6) covariance of the pose of that view, as a twist in the camera frame

    def error(self, pose: np.ndarray) -> np.ndarray:
        """Covariance (6, 6) that its pose error causes in a pose compared with it, T_camera_object (4, 4) now."""
        turned = np.kron(np.eye(2), pose[:3, :3] @ self.turn.T)
        return np.asarray(turned @ self.covariance @ turned.T)


def brightness(frame: Frame, placed: Placed, look: Look, number: int, cast: Cast) -> tuple[Rows, float]:
    """Brightness differences to a stored view, up to a gain and an offset, and the correlation with it.

    Occluded points and pixels of another object than `number` are ignored, as are points that another link hides in the
    `cast`, such as the keyboard below a lid.
    """
    rows, columns, inside = frame.nearest(placed.points)
    shown = cast.link_at(rows, columns)
    inside &= ~frame.others(rows, columns, number) & ((shown < 0) | (shown == look.spots.link))
    z = frame.depth[rows, columns]
    own = placed.points[:, 2]
    facing = (placed.normals * placed.points).sum(axis=1) < -0.2 * np.linalg.norm(placed.points, axis=1)
    fits = inside & facing & ((z == 0) | (np.abs(z - own) < 0.015))
    size = placed.motions.shape[2]
    if fits.sum() < 20:
        return Rows(np.zeros((0, size)), *3 * (np.zeros(0),), np.zeros((0, 1)), np.zeros(0, np.int64)), np.nan
    rows, columns = rows[fits], columns[fits]
    now, then = frame.smooth[rows, columns].astype(np.float64), look.grey[fits]
    spread_now, spread_then = now.std(), then.std()
    score = float(((now - now.mean()) * (then - then.mean())).mean() / max(spread_now * spread_then, 1e-9))
    gain = np.clip(spread_now / max(spread_then, 1.0), 0.4, 2.5)
    off = gain * (then - then.mean()) + np.median(now - gain * (then - then.mean())) - now
    slope = np.stack([each[rows, columns] for each in frame.slopes], axis=1).astype(np.float64)
    # A subpixel correction, because the brightness was sampled at the nearest pixel.
    exact = cameras.project(placed.points[fits], frame.k) - np.stack([columns, rows], axis=1)
    off -= (slope * exact).sum(axis=1)
    jacobian = np.einsum("nk,nkj->nj", slope, image_motion(frame, placed)[fits])
    weight = least_squares.huber(np.abs(off), 1.5 * GREY) / GREY**2
    # The texture of a distorted mesh is displaced.
    beside = slope * (placed.surface_m * frame.k[0, 0] / own[fits])[:, None]
    lasting = np.column_stack([np.full(len(off), GREY_LASTING), beside])
    told = Rows(jacobian, off, weight, np.full(len(off), GREY_NOISE), lasting, placed.patch[fits])
    return told, score if min(spread_now, spread_then) > 4.0 else np.nan
