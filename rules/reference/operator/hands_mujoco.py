"""Fingertips of a robot's hand by MuJoCo's forward kinematics."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(
    summary="forward kinematics of MuJoCo",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def tips(ctx: Context, robot: RobotModel, limb: str, positions: np.ndarray, options: Options) -> np.ndarray:
    """Tips (T, F, 3) [m] in the palm's frame at joint positions (T, A)."""
    from dextera_build.sim.model.forward import Kinematics

    kinematics = Kinematics(robot)
    names, parts = [joint.name for joint in robot.joints], robot.limbs[limb]
    found = []
    for number, row in enumerate(positions):
        kinematics.pose(dict(zip(names, row.tolist(), strict=True)))
        palm = transforms.invert(kinematics.frame(parts.palm))
        found.append([transforms.apply(palm, kinematics.frame(role)[:3, 3]) for role in parts.tips])
        ctx.progress(number + 1, len(positions), "moments")
    return np.array(found).reshape(len(positions), len(parts.tips), 3)
