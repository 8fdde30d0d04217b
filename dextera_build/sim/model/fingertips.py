"""How wide the fingers of a gripper are, from its collision shapes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.robots.limb import Limb
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.model.imported.assembly import corners_of

DEEP_M = 0.03
"""Length of a finger, from its tip backwards, of which the width counts [m]."""
WIDEST_M = 0.05
"""Largest width that is taken for that of a finger [m]."""


def half_width(robot: RobotModel, limb: Limb, joints: Mapping[str, float]) -> float:
    """Distance [m] of the fingers' sides from the middle of the tips, along x of the palm; 0 without shapes.

    Args:
        robot: The embodiment.
        limb: One of its limbs, with a palm whose z axis points along the fingers.
        joints: Joint of the hand -> position [rad or m]; the others are at home.
    """
    kinematics = Kinematics(robot)
    kinematics.pose(joints)
    model, data = kinematics.model, kinematics.data
    into = transforms.invert(kinematics.frame(limb.palm))
    base = transforms.rigid(data.body("base").xmat.reshape(3, 3), data.body("base").xpos)
    into = into @ transforms.invert(base)
    sites = [model.site(robot.frames[role]) for role in limb.tips]
    middle = np.mean([transforms.apply(into, data.site_xpos[site.id]) for site in sites], axis=0)
    widest = 0.0
    for body in {int(site.bodyid[0]) for site in sites}:
        pose = transforms.rigid(data.xmat[body].reshape(3, 3), data.xpos[body])
        first = int(model.body_geomadr[body])
        for geom in range(first, first + int(model.body_geomnum[body])):
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                points = transforms.apply(into @ pose, corners_of(model, geom).astype(np.float64)) - middle
                near = np.abs(points[points[:, 2] > -DEEP_M, 0])
                widest = max(widest, float(near.max(initial=0.0)))
    return min(widest, WIDEST_M)
