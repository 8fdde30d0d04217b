"""A known object for tracking: its links as ray casting structures, and its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from dextera_build.geometry import cameras, kinematics, raycast, transforms

RAYS = 1500
"""Approximate number of rays of one cast over the object's box."""
MESH_SIGMA_M = 0.0015
"""Standard deviation of a mesh from the true surface if it is not stated [m]."""
NORMAL = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""
FINEST_M, COARSEST_M = 0.0005, 0.005
"""Limits of a stated deviation of a mesh [m]."""


@dataclass(frozen=True)
class State:
    """State of an object."""

    pose: np.ndarray
    """T_camera_object (4, 4) [m]."""
    joints: np.ndarray
    """Positions (J,) [rad or m], in the order of `Model.joints`."""


@dataclass(frozen=True)
class Cast:
    """A model at one pose, ray-cast on a coarse grid of pixels (h, w)."""

    rows: np.ndarray  # (h,) row of each ray [px]
    columns: np.ndarray  # (w,) column of each ray [px]
    stride: int  # pixels per ray
    depth: np.ndarray  # (h, w) image-plane z of the nearest hit [m], inf without one
    link: np.ndarray  # (h, w) link of the hit, -1 without one
    points: np.ndarray  # (h, w, 3) hit in the frame of the object with its joints at 0 [m]
    normals: np.ndarray  # (h, w, 3) surface normal there, towards the camera, in the same frame

    @property
    def drawn(self) -> np.ndarray:
        """Rays that hit the model, (h, w) bool."""
        return self.link >= 0

    def link_at(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Link of the ray nearest to each pixel, in the shape of `rows` and `columns`; -1 without a hit."""
        down = (rows - self.rows[0] + self.stride // 2) // self.stride
        right = (columns - self.columns[0] + self.stride // 2) // self.stride
        height, width = self.link.shape
        within = (down >= 0) & (down < height) & (right >= 0) & (right < width)
        return np.where(within, self.link[down.clip(0, height - 1), right.clip(0, width - 1)], -1)


class Model:
    """An object prepared for tracking.

    Args:
        meshes: Link -> vertices (V, 3) [m] and faces (F, 3), in the object frame with every joint at 0.
        joints: A tree over the links, as in `kinematics.link_poses`.
        mesh_sigma_m: Standard deviation of the meshes from the true surface [m]; 0 for exact ones.
    """

    def __init__(
        self,
        meshes: Mapping[str, tuple[np.ndarray, np.ndarray]],
        joints: Sequence[kinematics.JointLike] = (),
        mesh_sigma_m: float = MESH_SIGMA_M,
    ) -> None:
        self.links, self.joints = dict(meshes), tuple(joints)
        self.mesh_sigma_m = float(mesh_sigma_m)
        self._scenes = [raycast.RayScene(mesh) for mesh in meshes.values()]
        self._names = tuple(meshes)
        self._hulls = [_outer(vertices) for vertices, _ in meshes.values()]
        self.chains = self._ancestors()
        points = np.concatenate(self._hulls)
        self.centre = (points.min(axis=0) + points.max(axis=0)) / 2
        self.radius = float(np.linalg.norm(points - self.centre, axis=1).max())
        self.corners = points

    @classmethod
    def of(cls, body: kinematics.BodyLike, residual_m: float | None = None) -> Self:
        """Prepare a body for tracking, such as `artifacts.object.Body`.

        Args:
            body: Its links and joints.
            residual_m: Stated median distance of the measured depth from it [m].
        """
        links = {name: (link.mesh.vertices, link.mesh.faces) for name, link in body.links.items()}
        if residual_m is None:
            return cls(links, body.joints)
        # It includes depth noise, so it is an upper bound of the mesh error.
        return cls(links, body.joints, mesh_sigma_m=min(max(NORMAL * residual_m, FINEST_M), COARSEST_M))

    @property
    def at_rest(self) -> np.ndarray:
        """Positions (J,) of the joints in the body."""
        return np.array([joint.position for joint in self.joints], np.float64)

    def link_poses(self, positions: np.ndarray) -> np.ndarray:
        """T_object_link (L, 4, 4) at joint positions (J,)."""
        if not self.joints:
            return np.tile(np.eye(4), (len(self._names), 1, 1))
        given = {joint.name: float(at) for joint, at in zip(self.joints, positions, strict=True)}
        found = kinematics.link_poses(self, given)
        return np.stack([found[name] for name in self._names])

    def limited(self, positions: np.ndarray) -> np.ndarray:
        """The nearest positions (J,) within the joints' limits, if they have any."""
        low = [getattr(joint, "lower", -np.inf) for joint in self.joints]
        high = [getattr(joint, "upper", np.inf) for joint in self.joints]
        return np.asarray(np.clip(positions, low, high))

    def box(self, state: State, k: np.ndarray, shape: tuple[int, ...], margin: float = 0.0) -> np.ndarray | None:
        """left, top, right, bottom [px] of the model in a picture (H, W), right and bottom excluded; None outside.

        Args:
            state: Its pose and joints.
            k: (3, 3) intrinsics [px].
            shape: Height and width.
            margin: Margin on each side, as a fraction of the size.
        """
        poses = state.pose @ self.link_poses(state.joints)
        points = np.concatenate([transforms.apply(pose, hull) for pose, hull in zip(poses, self._hulls, strict=True)])
        if points[:, 2].min() < 0.02:
            return None
        pixels = cameras.project(points, k)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        reach = margin * (high - low) + 2.0
        low, high = np.floor(low - reach), np.ceil(high + reach) + 1
        found = np.array([max(low[0], 0), max(low[1], 0), min(high[0], shape[1]), min(high[1], shape[0])]).astype(int)
        return found if found[2] - found[0] > 2 and found[3] - found[1] > 2 else None

    def cast(self, state: State, k: np.ndarray, shape: tuple[int, ...], rays: int = RAYS) -> Cast | None:
        """Cast rays through a coarse grid over the model's box; None if it is outside the picture."""
        box = self.box(state, k, shape)
        if box is None:
            return None
        left, top, right, bottom = (int(each) for each in box)
        stride = max(1, round(float(np.sqrt((right - left) * (bottom - top) / rays))))
        rows, columns = np.arange(top + stride // 2, bottom, stride), np.arange(left + stride // 2, right, stride)
        if not len(rows) or not len(columns):
            return None
        ahead = np.ones((len(rows), len(columns), 3))
        ahead[..., 0] = (columns - k[0, 2]) / k[0, 0]
        ahead[..., 1] = ((rows - k[1, 2]) / k[1, 1])[:, None]
        found: Cast | None = None
        for link, pose in enumerate(state.pose @ self.link_poses(state.joints)):
            now = self._hit(link, pose, ahead, (rows, columns, stride))
            found = now if found is None else _nearer(found, now)
        return found

    def _hit(self, link: int, pose: np.ndarray, ahead: np.ndarray, grid: tuple[np.ndarray, np.ndarray, int]) -> Cast:
        turn = pose[:3, :3]
        directions = (ahead @ turn).astype(np.float32)
        origin = (-pose[:3, 3] @ turn).astype(np.float32)
        rays = np.concatenate([np.broadcast_to(origin, directions.shape), directions], axis=-1)
        hits = self._scenes[link].cast(rays)
        depth, normals = hits.distance, hits.normals
        drawn = np.isfinite(depth)
        away = (normals * directions).sum(axis=-1) > 0
        normals = np.where(away[..., None], -normals, normals)
        points = origin + np.where(drawn, depth, 0)[..., None] * directions
        return Cast(*grid, depth.astype(np.float64), np.where(drawn, link, -1), points, normals)

    def _ancestors(self) -> np.ndarray:
        """Whether joint j moves link l, (L, J) bool."""
        moves = np.zeros((len(self._names), len(self.joints)), bool)
        above = {joint.child: number for number, joint in enumerate(self.joints)}
        for row, name in enumerate(self._names):
            at: Any = name
            while at in above:
                moves[row, above[at]] = True
                at = self.joints[above[at]].parent
        return moves


def _outer(vertices: np.ndarray) -> np.ndarray:
    """Corners of the convex hull that are extreme along 42 directions."""
    points = np.asarray(vertices, np.float64)
    steps = np.stack(np.meshgrid(*3 * [np.linspace(-1, 1, 5)]), axis=-1).reshape(-1, 3)
    ways = steps[np.abs(steps).max(axis=1) == 1]
    return np.asarray(points[np.unique((points @ ways.T).argmax(axis=0))])


def _nearer(one: Cast, other: Cast) -> Cast:
    first = one.depth <= other.depth
    return Cast(
        one.rows,
        one.columns,
        one.stride,
        np.where(first, one.depth, other.depth),
        np.where(first, one.link, other.link),
        np.where(first[..., None], one.points, other.points),
        np.where(first[..., None], one.normals, other.normals),
    )
