"""reference.robot_views: a calibration capture of a reference world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydantic import PositiveInt

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.cameras.camera import Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.rule import Context, rule
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.sim.render.shot import Shot

from ..sensor import ColourNoiseOptions, DepthNoiseOptions
from .postures import PosturesOptions, cleared


class RobotViewsOptions(PosturesOptions):
    """Options of reference.robot_views."""

    supersample: PositiveInt = 2
    """Samples per pixel edge of the colour render."""
    depth_noise: DepthNoiseOptions = DepthNoiseOptions()
    """Noise of the depth stream."""
    colour_noise: ColourNoiseOptions = ColourNoiseOptions()
    """Noise of the colour stream."""


@dataclass(frozen=True)
class Posed:
    """Result of a backend: ideal pictures, and the true joint positions."""

    shots: list[Shot]
    joints: np.ndarray  # (K, J) of the robot's actuated joints, in the order of its model [rad]


class ViewsBackend(Protocol):
    """Interface of a backend of reference.robot_views."""

    def posed(
        self,
        ctx: Context,
        world: World,
        robot: RobotModel,
        board: Board,
        rows: np.ndarray | None,
        common: RobotViewsOptions,
        options: Any,
    ) -> Posed:
        """Photograph the robot at joint positions `rows` (K, J) [rad], or in random postures if None."""
        ...


@rule(version=1, packages=("numpy", "scipy"), cpus=2, memory_gb=2.0)
def robot_views(
    ctx: Context[ViewsBackend],
    world: World,
    robot: RobotModel,
    postures: Joints | None = None,
    *,
    options: RobotViewsOptions | None = None,
) -> RobotViews:
    """Return pictures with depth [m] of the world's robot in several poses with a board on its flange, and its joints.

    A simulated substitute for a calibration session: pictures, depth and encoders have errors, and the robot may differ
    from its model. The pose of camera and base is not in the result. `postures` are those of `reference.postures` with
    the same options, for comparisons; without them, postures are drawn here.
    """
    options = options or RobotViewsOptions()
    board = options.board.board(ctx)
    rows = None if postures is None else postures.positions
    posed = ctx.backend.posed(ctx, cleared(ctx, world, options), robot, board, rows, options, ctx.backend_options)
    draw = np.random.default_rng([options.seed, 1])
    captures = {}
    for number, shot in enumerate(posed.shots):
        depth = measure_depth(shot.depth, shot.rgb, world.camera.matrix(), options.depth_noise, draw)
        pixels = measure_colour(shot.rgb, options.colour_noise, draw)
        captures[f"pose_{number:02d}"] = Capture(
            photograph=Photograph(rgb=Image(pixels=pixels), camera=world.camera),
            measured=Measured(depth=DepthImage(depth=depth)),
        )
    arm = np.array([joint.group == "arm" for joint in robot.joints])
    errors = options.errors
    zero = np.radians(errors.zero_sigma_deg) * draw.normal(size=posed.joints.shape[1])
    reading = np.radians(errors.encoder_sigma_deg) * draw.normal(size=posed.joints.shape)
    names = tuple(joint.name for joint in robot.joints)
    stamps = np.arange(len(captures), dtype=np.float64)
    joints = Joints(names=names, stamps=stamps, positions=posed.joints + np.where(arm, zero + reading, 0.0))
    for name in list(captures)[:3]:
        ctx.preview(captures[name].photograph.rgb.pixels, name)
    ctx.say(
        f"{len(captures)} poses; arm {100 * errors.arm_shape:+g} % in shape, {100 * errors.arm_length:+g} % in length, "
        f"encoders {errors.zero_sigma_deg:g} deg zero, {errors.encoder_sigma_deg:g} deg noise; simulated"
    )
    return RobotViews(
        captures=captures, mount="eye_on_base", joints=joints, effector_frame=options.board.frame, board=board
    )
