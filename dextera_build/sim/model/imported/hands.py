"""Geometry of a hand's guess: the directions of its palm, and the ends of its fingers, from the meshes of a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.geometry import quaternions
from dextera_build.sim.model.imported import limbs
from dextera_build.sim.model.imported.assembly import compiled, corners_of

END_M = 0.012
"""Length of the part of a finger that is its end [m]."""
IN_M = 0.004
"""Distance of a tip from the end of its finger [m]."""
BACK_M = 0.03
"""Distance of the palm's frame behind the tips of a gripper [m]."""
SIDE_M, WIDE_M = 0.04, 0.08
"""Height of the sides of a tool's end that meet an object, and their largest distance from its middle [m]."""
RIM_M, APART_M = 0.003, 0.05
"""Depth of a side of a tool's end, and distance of its points from their middle above which they are several [m]."""
SWING_RAD = 1.2
"""Largest opening of a jaw that turns, from closed [rad]."""
_STRAIGHT = 0.7
"""Cosine of the angle to the fingers, up to which the axis of the last joint of an arm is the direction of its hand."""


@dataclass(frozen=True)
class Spot:
    """A frame on a link: position [m] and quaternion w x y z."""

    link: str
    at: np.ndarray
    turn: np.ndarray


class Shape:
    """Poses and outlines of the links of a file at given joint positions.

    Args:
        spec: The `mujoco.MjSpec`; it is compiled.
        followers: Joint -> the joint that it follows, ratio and offset.
    """

    def __init__(self, spec: Any, followers: Mapping[str, tuple[str, float, float]]) -> None:
        self._model, self._followers = compiled(spec), followers
        self.data = mujoco.MjData(self._model)
        self._posture = {
            name: float(np.clip(0.0, *self.limits(name)))
            for name in (self._model.joint(number).name for number in range(self._model.njnt))
        }
        self.place({})

    def limits(self, joint: str) -> tuple[float, float]:
        """Limits of a joint; a turn to each side if the file has none."""
        low, high = (float(each) for each in self._model.joint(joint).range)
        return (low, high) if low < high else (-np.pi, np.pi)

    def place(self, joints: Mapping[str, float]) -> None:
        """Move joints [rad or m], and those that follow them."""
        self._posture |= joints
        for name, position in self._posture.items():
            self.data.joint(name).qpos[0] = position
        for name, (leader, ratio, offset) in self._followers.items():
            self.data.joint(name).qpos[0] = ratio * self._posture.get(leader, 0.0) + offset
        mujoco.mj_kinematics(self._model, self.data)

    def contacts(self) -> set[tuple[int, int]]:
        """Numbers of the links that touch one another, each pair in order."""
        mujoco.mj_collision(self._model, self.data)
        bodies = self._model.geom_bodyid
        pairs = [sorted(int(bodies[geom]) for geom in each.geom) for each in self.data.contact if each.dist < 0]
        return {(one, other) for one, other in pairs}

    def inside(self, body: Any, points: np.ndarray) -> np.ndarray:
        """World points (N, 3) in the frame of a link."""
        found = self.data.body(body.name)
        return np.asarray((points - found.xpos) @ found.xmat.reshape(3, 3))

    def turned(self, body: Any, axes: np.ndarray) -> np.ndarray:
        """Quaternion, in the frame of a link, of world axes: the columns of (3, 3)."""
        return np.asarray(quaternions.from_matrix(self.data.body(body.name).xmat.reshape(3, 3).T @ axes))

    def outline(self, body: Any) -> np.ndarray:
        """World points (N, 3) of a link and all its descendants [m]; their origins if nothing has a shape."""
        found, places = [], []
        for each in limbs.subtree(body):
            number = int(self._model.body(each.name).id)
            pose, turn = self.data.xpos[number], self.data.xmat[number].reshape(3, 3)
            places.append(pose)
            first = int(self._model.body_geomadr[number])
            for geom in range(first, first + int(self._model.body_geomnum[number])):
                found.append(corners_of(self._model, geom) @ turn.T + pose)
        return np.concatenate(found) if found else np.array(places)

    def ahead(self, branch: limbs.Branch, ends: np.ndarray) -> np.ndarray:
        """Direction (3,) in the world from an arm to the ends of its fingers `ends` (N, 3).

        The axis of the arm's last joint, where it points about there: the flange of most arms turns about it.
        """
        joints = [joint for body in limbs.way(branch.top, branch.palm) for joint in body.joints]
        origin = self.data.body(branch.palm.name).xpos
        if joints:
            axis, origin = self.data.joint(joints[-1].name).xaxis, self.data.joint(joints[-1].name).xanchor
        towards = ends.mean(axis=0) - origin
        towards = towards / max(float(np.linalg.norm(towards)), 1e-9)
        if joints and abs(float(axis @ towards)) > _STRAIGHT:
            return np.asarray(axis * np.sign(axis @ towards))
        return np.asarray(towards)

    def outwards(self, branch: limbs.Branch) -> np.ndarray:
        """Direction (3,) in the world of the end of an arm without a hand: the axis about which its flange turns."""
        joints = [joint.name for body in limbs.way(branch.top, branch.palm) for joint in body.joints]
        if not joints:
            return np.array([0.0, 0.0, 1.0])
        axis = self.data.joint(joints[-1]).xaxis
        before = self.data.joint(joints[-2 if len(joints) > 1 else -1]).xanchor
        along = float(axis @ (self.data.body(branch.palm.name).xpos - before))
        return np.asarray(axis if along >= 0 else -axis)


def square(ahead: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Axes (3, 3) in columns: z is `ahead`, y the part of `across` at right angles to it."""
    z = ahead / np.linalg.norm(ahead)
    y = across - (across @ z) * z
    if np.linalg.norm(y) < 1e-6:
        y = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def end(points: np.ndarray, ahead: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """A point (3,) on the inner side of the end of a finger, whose outline is `points` (N, 3).

    Args:
        points: Outline of the finger [m].
        ahead: Direction of the finger.
        inner: Direction in which its inner side faces.
    """
    along = points @ ahead
    tip = points[along > along.max() - END_M]
    middle = (tip.min(axis=0) + tip.max(axis=0)) / 2
    middle = middle + ((tip @ inner).max() - middle @ inner) * inner
    return np.asarray(middle + (float(along.max()) - IN_M - middle @ ahead) * ahead)


def rim(points: np.ndarray, tip: np.ndarray, axes: np.ndarray) -> dict[str, tuple[float, float]]:
    """Role -> x and y [m] of the four sides of the end of a tool, with which it pushes.

    Args:
        points: Outline of the tool (N, 3) [m].
        tip: The middle of its end (3,).
        axes: Axes (3, 3) in columns, z out of the end.
    """
    local = (points - tip) @ axes
    near = local[local[:, 2] > -SIDE_M][:, :2]
    found = {}
    for role, way in {"tip_front": (1, 0), "tip_back": (-1, 0), "tip_left": (0, 1), "tip_right": (0, -1)}.items():
        along = near @ way
        farthest = near[along > along.max() - RIM_M]
        # The middle of the side of a box; of two fingers, one, because nothing is between them.
        if float(np.linalg.norm(farthest - farthest.mean(axis=0), axis=1).min()) > APART_M:
            farthest = farthest[np.linalg.norm(farthest - farthest[0], axis=1) < APART_M]
        x, y = np.clip(farthest.mean(axis=0), -WIDE_M, WIDE_M).tolist()
        found[role] = (x, y)
    return found
