"""capture.mount: pose of the robot, as from a robot-camera calibration."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt

from dextera_build.artifacts.pose import Pose
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.world import World
from dextera_build.errors import listing
from dextera_build.geometry import registration, transforms
from dextera_build.rule import Context, Options, rule

BASE = "base"
"""Root body of every robot model."""


class MountOptions(Options):
    """Options of capture.mount: errors of the simulated calibration."""

    seed: NonNegativeInt = 0
    """Seed of both errors."""
    position_sigma_m: NonNegativeFloat = 0.001
    """Standard deviation of the base's position along each axis [m]."""
    rotation_sigma_deg: NonNegativeFloat = 0.1
    """Standard deviation of the base's rotation about each axis [deg]."""


@rule(version=1, packages=("numpy",))
def mount(ctx: Context, world: World, robot: RobotModel, *, options: MountOptions | None = None) -> Pose:
    """Return T_camera_base [m]: the true pose in a reference world with the declared calibration error.

    This simulates a calibration from pictures of the moving robot and returns only its result: the true pose
    with one draw of normal errors.
    """
    options = options or MountOptions()
    if world.stand is None:
        ctx.fail("this world has no robot", hint="give `capture.world` option `robot`, or leave `measured` out")
    if BASE not in robot.links:
        ctx.fail(f"the robot has no body `{BASE}`", bodies=listing(robot.links))
    rng = np.random.default_rng(options.seed)
    shift = rng.normal(size=3) * options.position_sigma_m
    turn = rng.normal(size=3) * np.radians(options.rotation_sigma_deg)
    truth = (world.camera_pose.inverse() @ world.stand.pose()).matrix
    rotation = truth[:3, :3] @ registration.rotation(turn)
    found = Pose(parent="camera", child=BASE, matrix=transforms.rigid(rotation, truth[:3, 3] + shift))
    off, angle = 1000 * float(np.linalg.norm(shift)), float(np.degrees(np.linalg.norm(turn)))
    ctx.metric("simulated position error", off, "mm")
    ctx.metric("simulated rotation error", angle, "deg")
    away = float(np.linalg.norm(found.matrix[:3, 3]))
    ctx.say(f"base {away:.2f} m from the camera; simulated, with an error of {off:.1f} mm and {angle:.2f} deg")
    return found
