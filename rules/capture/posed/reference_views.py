"""capture.reference_views: a calibration capture of a reference world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.calibration import Board
from dextera_build.artifacts.camera import Capture, Measured, Photograph
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.robot_views import RobotViews
from dextera_build.artifacts.stream import Joints
from dextera_build.artifacts.world import World
from dextera_build.rule import Context, Options, rule
from dextera_build.sim.render.sensor import measure_colour, measure_depth
from dextera_build.sim.render.shot import Shot

from ..sensor import ColourNoiseOptions, DepthNoiseOptions


class PlateOptions(Options):
    """The board on the robot: a grid of ArUco markers on a plate."""

    columns: PositiveInt = 4
    """Markers along x."""
    rows: PositiveInt = 3
    """Markers along y."""
    square_m: PositiveFloat = 0.036
    """Distance from one marker to the next [m]."""
    marker_m: PositiveFloat = 0.028
    """Side of a marker [m]."""
    dictionary: str = "DICT_4X4_50"
    """Family of the markers."""
    frame: str = "flange"
    """Frame of the robot that it is fixed to."""
    origin_m: tuple[float, float, float] = (0.085, -0.068, 0.0)
    """Upper left corner of the markers in that frame [m]."""
    x_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Direction of its x axis in that frame."""
    y_axis: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Direction of its y axis, which points down on the board."""


class RobotErrorOptions(Options):
    """How the robot differs from its model."""

    arm_shape: float = Field(0.0, ge=-0.2, le=0.2)
    """Relative size of the arm's surfaces about each link's origin, less 1."""
    arm_length: float = Field(0.0, ge=-0.2, le=0.2)
    """Relative length of the arm's links, less 1."""
    zero_sigma_deg: NonNegativeFloat = 0.0
    """Standard deviation of the zero of each arm joint's encoder, the same in all pictures [deg]."""
    encoder_sigma_deg: NonNegativeFloat = 0.01
    """Standard deviation of each reading of an arm joint [deg]."""


class ReferenceViewsOptions(Options):
    """Options of capture.reference_views."""

    count: PositiveInt = 10
    """Number of pictures."""
    seed: NonNegativeInt = 0
    """Seed of the postures and all errors."""
    reach_deg: PositiveFloat = 45.0
    """Largest difference of an arm joint from its position in the world [deg]."""
    widest_deg: PositiveFloat = Field(55.0, lt=90.0)
    """Largest angle between the board's normal and the ray to the camera [deg]."""
    supersample: PositiveInt = 2
    """Samples per pixel edge of the colour render."""
    board: PlateOptions = PlateOptions()
    """The board."""
    errors: RobotErrorOptions = RobotErrorOptions()
    """The robot's differences from its model."""
    depth_noise: DepthNoiseOptions = DepthNoiseOptions()
    """Noise of the depth stream."""
    colour_noise: ColourNoiseOptions = ColourNoiseOptions()
    """Noise of the colour stream."""


@dataclass(frozen=True)
class Posed:
    """What a backend makes: ideal pictures, and where the joints really were."""

    shots: list[Shot]
    joints: np.ndarray  # (K, J) of the robot's actuated joints, in the order of its model [rad]


class ViewsBackend(Protocol):
    """What a backend of capture.reference_views defines."""

    def posed(
        self, ctx: Context, world: World, robot: RobotModel, board: Board, common: ReferenceViewsOptions, options: Any
    ) -> Posed:
        """Choose postures in which the board is seen, and photograph them."""
        ...


@rule(version=1, packages=("numpy", "scipy"), cpus=2, memory_gb=2.0)
def reference_views(
    ctx: Context[ViewsBackend], world: World, robot: RobotModel, *, options: ReferenceViewsOptions | None = None
) -> RobotViews:
    """Return pictures with depth [m] of the world's robot in several poses with a board on its flange, and its joints.

    A simulated substitute for a calibration session: pictures, depth and encoders have errors, and the robot may differ
    from its model. The pose of camera and base is not in the result.
    """
    options = options or ReferenceViewsOptions()
    if world.stand is None:
        ctx.fail("this world has no robot", hint="give `capture.world` option `robot`")
    board = Board(kind="aruco", **{key: getattr(options.board, key) for key in _OF_BOARD})
    ctx.check(board.marker_m < board.square_m, "the markers of the board overlap", hint="lower `board.marker_m`")
    posed = ctx.backend.posed(ctx, world, robot, board, options, ctx.backend_options)
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


_OF_BOARD = ("columns", "rows", "square_m", "marker_m", "dictionary")
