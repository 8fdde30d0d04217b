"""Transparent hands of a robot at their targets, and an operator's hands as skeletons, in a rendered scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.geometry import hands, quaternions
from dextera_build.sim.model.skins import FIRST_HIDDEN

GHOST = (0.35, 0.65, 1.0, 0.4)
OPERATOR = ((0.94, 0.53, 0.24, 1.0), (0.30, 0.76, 0.54, 1.0))
"""Colours of the left and of the right hand."""
BONE_M = 0.004
"""Radius of a bone [m]."""


def add_links(scene: Any, model: Any, bodies: Sequence[int], poses: np.ndarray) -> None:
    """Draw the visible shapes of bodies a second time, transparent.

    Args:
        scene: `mjvScene` of a renderer, after its update.
        model: The compiled model.
        bodies: (K,) bodies.
        poses: (K, 7) poses in the world: position [m], quaternion w x y z.
    """
    for body, pose in zip(bodies, poses, strict=True):
        turn = quaternions.to_matrix(pose[3:])
        first = int(model.body_geomadr[body])
        for geom in range(first, first + int(model.body_geomnum[body])):
            if model.geom_group[geom] >= FIRST_HIDDEN:
                continue
            place = pose[:3] + turn @ model.geom_pos[geom]
            frame = turn @ quaternions.to_matrix(model.geom_quat[geom])
            shape = _next(scene)
            mujoco.mjv_initGeom(
                shape, int(model.geom_type[geom]), model.geom_size[geom], place, frame.ravel(), np.array(GHOST)
            )
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                # In a scene, meshes and their hulls take turns.
                shape.dataid = 2 * int(model.geom_dataid[geom])


def add_skeleton(scene: Any, points: np.ndarray, hand: int) -> None:
    """Draw the bones of an operator's hand.

    Args:
        scene: `mjvScene` of a renderer, after its update.
        points: (25, 3) joints in the world [m].
        hand: 0 for the left hand, 1 for the right one.
    """
    for joint in range(1, len(points)):
        shape = _next(scene)
        mujoco.mjv_initGeom(
            shape,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            np.zeros(3),
            np.zeros(3),
            np.eye(3).ravel(),
            np.array(OPERATOR[hand]),
        )
        ends = points[hands.PARENTS[joint]], points[joint]
        mujoco.mjv_connector(shape, mujoco.mjtGeom.mjGEOM_CAPSULE, BONE_M, *ends)


def _next(scene: Any) -> Any:
    """A new shape of a scene."""
    shape = scene.geoms[scene.ngeom]
    scene.ngeom += 1
    return shape
