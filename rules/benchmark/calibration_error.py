"""benchmark.calibration_error: errors of a robot-camera calibration, at the camera and at the hand."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.artifacts.table import Table
from dextera_build.geometry import transforms
from dextera_build.rule import Context, Options, rule

from . import errors


class CalibrationErrorOptions(Options):
    """Options of benchmark.calibration_error."""

    frame: str = "palm"
    """Frame or link of the robot at which the hand's error is measured."""


@rule(version=1, packages=("numpy", "scipy", "mujoco"))
def calibration_error(
    ctx: Context,
    world: World,
    robot: RobotModel,
    views: RobotViews,
    postures: Joints,
    calibration: Calibration,
    *,
    options: CalibrationErrorOptions | None = None,
) -> Table:
    """Return the errors of the hand [mm] and of T_base_camera [mm, deg] against the world's truth.

    The hand's error is the mean over the pictures of the distance, in the camera's frame, between its position by
    calibration, model and encoders and its true position. `postures` are the joints' true positions of
    `reference.postures`; the robot's links must have the model's lengths (`errors.arm_length` 0).
    """
    from dextera_build.sim.model import forward

    options = options or CalibrationErrorOptions()
    if world.stand is None or views.joints is None:
        ctx.fail(
            "there is no robot with known joints to compare with",
            hint="give the world of `reference.place_robot_in_view`",
        )
    ctx.check(
        postures.positions.shape == views.joints.positions.shape,
        f"{len(postures.positions)} true postures for {len(views.joints.positions)} pictures",
        hint="give `reference.robot_views` the same `postures`",
    )
    truth = errors.camera_base(world.stand.pose().matrix, world.camera_pose.matrix)
    found = calibration.pose.matrix
    stated, real = (
        forward.frames(robot, each.names, each.positions, options.frame)[:, :3, 3] for each in (views.joints, postures)
    )
    ours = transforms.apply(transforms.invert(found), stated)
    apart = np.linalg.norm(ours - transforms.apply(transforms.invert(truth), real), axis=1)
    error = errors.off(found, truth)
    hand = 1000 * float(apart.mean())
    rows: list[errors.Row] = [("", "hand", "mm", hand, None)]
    rows += errors.place_and_turn("", "camera", error, calibration.pose.covariance)
    joint = errors.inside(error, calibration.pose.covariance)
    rows = [(*row[:4], joint) if row[1].startswith("camera") else row for row in rows]
    ctx.metric("hand", hand, "mm")
    ctx.say(f"hand {hand:.2f} mm, camera {rows[1][3]:.2f} mm and {rows[2][3]:.3f} deg off")
    return errors.table(
        "A calibration against the truth",
        rows,
        (
            f"hand: distance in the camera's frame between `{options.frame}` by calibration, model and encoders and "
            "where it is, mean over the calibration pictures",
            "camera: of its place and rotation in the robot's base; in region: all six numbers jointly",
        ),
    )
