"""A robot's hand beside an operator's as retargeting sees it, and its fingertips by MuJoCo's forward kinematics."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.retarget.correspondence import Correspondence

BACKEND = Backend(
    summary="correspondence of retargeting, forward kinematics of MuJoCo",
    profiles=("cpu",),
    packages=("mujoco",),
    extra="twin",
)


def beside(ctx: Context, robot: RobotModel, limb: str, lengths_m: np.ndarray, options: Options) -> Correspondence:
    """Points of a human hand that are those of a limb's hand, by its frames and geometry.

    Raises:
        RuleError: The limb has no hand that a human one can move.
    """
    from dextera_build.sim.retarget.matching import matched

    return matched(robot, limb).beside(lengths_m)


def tips(
    ctx: Context, robot: RobotModel, limb: str, own: Correspondence, positions: np.ndarray, options: Options
) -> np.ndarray:
    """Tips (T, F, 3) [m] in the palm's frame at joint positions (T, A)."""
    from dextera_build.sim.model.forward import Kinematics

    kinematics = Kinematics(robot)
    names, palm = [joint.name for joint in robot.joints], robot.limbs[limb].palm
    found = []
    for number, row in enumerate(positions):
        kinematics.pose(dict(zip(names, row.tolist(), strict=True)))
        from_base = transforms.invert(kinematics.frame(palm))
        found.append([transforms.apply(from_base, kinematics.frame(role)[:3, 3]) for role in own.roles])
        ctx.progress(number + 1, len(positions), "moments")
    return np.array(found).reshape(len(positions), len(own.roles), 3)
