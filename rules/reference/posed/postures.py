"""reference.postures: joint positions of a robot in the pictures of a calibration capture."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.rule import Context, Options, rule


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
    """Frame of the robot that the plate is mounted on."""
    origin_m: tuple[float, float, float] = (0.085, -0.068, 0.0)
    """Upper left corner of the markers in that frame [m]."""
    x_axis: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Direction of its x axis in that frame."""
    y_axis: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Direction of its y axis, which points down on the board."""

    def board(self, ctx: Context) -> Board:
        """The board as described in a calibration."""
        board = Board(kind="aruco", **{key: getattr(self, key) for key in _OF_BOARD})
        ctx.check(board.marker_m < board.square_m, "the markers of the board overlap", hint="lower `board.marker_m`")
        return board


class RobotErrorOptions(Options):
    """Differences between the robot and its model."""

    arm_shape: float = Field(0.0, ge=-0.2, le=0.2)
    """Relative scale error of the arm's surfaces about each link's origin."""
    arm_length: float = Field(0.0, ge=-0.2, le=0.2)
    """Relative error of the length of the arm's links."""
    zero_sigma_deg: NonNegativeFloat = 0.0
    """Standard deviation of the zero offset of each arm joint's encoder, the same in all pictures [deg]."""
    encoder_sigma_deg: NonNegativeFloat = 0.01
    """Standard deviation of each reading of an arm joint [deg]."""


class PosturesOptions(Options):
    """Options of reference.postures, shared with `reference.robot_views`."""

    count: PositiveInt = 10
    """Number of pictures."""
    seed: NonNegativeInt = 0
    """Seed of the postures and all errors."""
    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint -> position around which postures are drawn [deg]; omitted joints use their position in the world."""
    reach_deg: PositiveFloat = 45.0
    """Largest deviation of an arm joint from that position [deg]."""
    tries: PositiveInt = 4000
    """Maximum number of postures that are drawn."""
    widest_deg: PositiveFloat = Field(55.0, lt=90.0)
    """Largest angle between the board's normal and the ray to the camera [deg]."""
    board: PlateOptions = PlateOptions()
    """The board."""
    errors: RobotErrorOptions = RobotErrorOptions()
    """Differences between the robot and its model."""
    things: bool = True
    """Whether the world's objects are on the table; False gives the robot more free space."""


class PosturesBackend(Protocol):
    """Interface of a backend of reference.postures."""

    def chosen(
        self, ctx: Context, world: World, robot: RobotModel, board: Board, common: PosturesOptions, options: Any
    ) -> np.ndarray:
        """Joint positions (K, J) [rad], in the order of the robot's joints, in which board and hand are visible."""
        ...


@rule(version=1, packages=("numpy",), memory_gb=2.0)
def postures(
    ctx: Context[PosturesBackend], world: World, robot: RobotModel, *, options: PosturesOptions | None = None
) -> Joints:
    """Return the true joint positions of each picture [rad], drawn around their positions in the world.

    For `reference.robot_views` and `evaluate.*` only: the encoder readings are in the joints of the pictures.
    """
    options = options or PosturesOptions()
    rows = ctx.backend.chosen(
        ctx, cleared(ctx, world, options), robot, options.board.board(ctx), options, ctx.backend_options
    )
    ctx.say(f"{len(rows)} postures")
    return Joints(
        names=tuple(joint.name for joint in robot.joints),
        stamps=np.arange(len(rows), dtype=np.float64),
        positions=np.ascontiguousarray(rows, np.float64),
    )


def cleared(ctx: Context, world: World, options: PosturesOptions) -> World:
    """The world with or without its objects, by the options; raises without a robot."""
    if world.stand is None:
        ctx.fail("this world has no robot", hint="give `reference.world` option `robot`")
    return world if options.things else world.model_copy(update={"objects": {}})


_OF_BOARD = ("columns", "rows", "square_m", "marker_m", "dictionary")
