"""A joint of an object that a hand moves: the pose of its link, and contact points for pushing."""

from __future__ import annotations

import mujoco
import numpy as np

from dextera_build.geometry import transforms


class Mechanism:
    """One joint of an object and its link.

    Poses are relative to the object's root body, so they do not depend on the object's pose.

    Args:
        model: Compiled model that contains the object.
        joint: Name of a hinge or slide.
    """

    def __init__(self, model: mujoco.MjModel, joint: str) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        if model.nkey:
            mujoco.mj_resetDataKeyframe(model, self._data, 0)
        number = model.joint(joint).id
        self._address = int(model.jnt_qposadr[number])
        self._link = int(model.jnt_bodyid[number])
        self._root = int(model.body_rootid[self._link])
        self.turns = bool(model.jnt_type[number] == mujoco.mjtJoint.mjJNT_HINGE)
        """Whether it is a hinge."""
        self.axis = model.jnt_axis[number].copy()
        """Axis (3,) in the link's frame."""
        self.pivot = model.jnt_pos[number].copy()
        """A point of the axis (3,) in the link's frame [m]."""
        self.points = surface_points(model, self._link)
        """(N, 3) corners of the link's collision geometry, in its frame [m]."""

    def pose(self, position: float) -> np.ndarray:
        """T_root_link (4, 4) with the joint at `position` [rad or m]."""
        self._data.qpos[self._address] = position
        mujoco.mj_kinematics(self._model, self._data)
        root, link = (
            transforms.rigid(self._data.xmat[body].reshape(3, 3).copy(), self._data.xpos[body].copy())
            for body in (self._root, self._link)
        )
        return np.asarray(transforms.invert(root) @ link)

    def pushed_at(self, way: float, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Contact point and direction of a push, both (3,) in the link's frame [m].

        Args:
            way: Direction of the joint's motion, by sign.
            share: Distance from the axis, as a fraction of the link's reach; ignored for a slide.
        """
        arms = self.points - self.pivot
        along = arms @ self.axis
        if self.turns:
            across = arms - np.outer(along, self.axis)
            radius = np.linalg.norm(across, axis=1)
            outer = across[radius >= 0.9 * radius.max()].mean(axis=0)
            outer /= np.linalg.norm(outer)
            push = np.cross(self.axis, outer) * np.sign(way)
            middle = self.axis * (along.min() + along.max()) / 2 + outer * share * float((arms @ outer).max())
        else:
            push = self.axis * np.sign(way)
            middle = arms.mean(axis=0)
        back = float((arms @ push).min())
        return np.asarray(self.pivot + middle + push * (back - middle @ push)), np.asarray(push)


def surface_points(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Corners (N, 3) of a body's collision geometry, in its frame [m]; its centre of mass if it has none."""
    found = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        found.append(_corners(model, int(geom)) @ rotation.reshape(3, 3).T + model.geom_pos[geom])
    return np.concatenate(found or [np.atleast_2d(model.body_ipos[body])])


def _corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    mesh = int(model.geom_dataid[geom])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and mesh >= 0:
        first = model.mesh_vertadr[mesh]
        return np.asarray(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], np.float64)
    centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    return np.asarray(centre + signs * half)
