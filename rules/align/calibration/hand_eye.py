"""align.hand_eye: pose of a camera relative to a robot's base or hand, from pictures of a board."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class HandEyeOptions(Options):
    """Options of align.hand_eye: requirements for a calibration."""

    effector_frame: str = ""
    """Frame or link of the robot that the board or the camera is mounted on; empty: the one named in the capture."""
    least_views: PositiveInt = Field(5, ge=3)
    """Minimum number of mutually consistent pictures."""
    most_bad: int = Field(2, ge=0)
    """Maximum number of inconsistent pictures, which are left out and named."""
    least_turn_deg: PositiveFloat = 5.0
    """Minimum root mean square rotation between pictures about a second axis [deg]."""
    most_corner_px: PositiveFloat = 3.0
    """Root mean square distance of a picture's corners from a flat board above which they are not those of the board
    [px]."""
    most_residual_m: PositiveFloat = 0.01
    """Maximum root mean square residual of the chain of poses [m]."""
    most_residual_deg: PositiveFloat = 2.0
    """Maximum root mean square residual of its rotation [deg]."""
    most_sigma_m: PositiveFloat = 0.02
    """Maximum standard deviation of the camera's position [m]."""
    joint_sigma_deg: NonNegativeFloat = 0.05
    """Standard deviation of the zero offset of each arm joint's encoder, for the covariance if joints are known
    [deg]."""
    board_size_fraction: PositiveFloat = 0.03
    """Relative deviation of the board's size from the stated one above which the board is refused, if significant."""


class HandEyeBackend(Protocol):
    """Interface of a backend of align.hand_eye."""

    def solve(
        self,
        ctx: Context,
        views: RobotViews,
        board: Board,
        robot: RobotModel | None,
        common: HandEyeOptions,
        options: Any,
    ) -> Calibration:
        """The calibration, with its residuals and covariance."""
        ...


@rule(version=1, packages=("numpy", "scipy"), tolerance=Tolerance({"": ROUNDING}))
def hand_eye(
    ctx: Context[HandEyeBackend],
    views: RobotViews,
    robot: RobotModel | None = None,
    *,
    options: HandEyeOptions | None = None,
) -> Calibration:
    """Return T_base_camera, or T_effector_camera of a camera on the hand, with covariance and leave-one-out residuals.

    All corners of all pictures and the robot's own pose errors enter one least squares problem (the hand-eye problem of
    Tsai and Lenz 1989, solved jointly for camera and board). Degenerate motion and a board of another size are refused;
    pictures that contradict the others are named.
    """
    options = options or HandEyeOptions()
    if views.board is None:
        ctx.fail("the capture states no board", hint="describe the board in the capture's `target`")
    found = ctx.backend.solve(ctx, views, views.board, robot, options, ctx.backend_options)
    rms = (0.0, 0.0)
    if found.residuals is not None and len(found.residuals):
        distance, angle = np.sqrt((found.residuals**2).mean(axis=0))
        rms = 1000 * float(distance), float(np.degrees(angle))
    sigma = found.pose.sigma() or (0.0, 0.0)
    ctx.metric("residual", rms[0], "mm")
    ctx.metric("residual rotation", rms[1], "deg")
    ctx.metric("sigma", 1000 * sigma[0], "mm")
    ctx.metric("sigma rotation", float(np.degrees(sigma[1])), "deg")
    ctx.say(
        f"T_{found.pose.parent}_{found.pose.child} from {found.observations()} of {len(views.captures)} pictures, "
        f"residuals {rms[0]:.1f} mm and {rms[1]:.2f} deg, "
        f"sigma {1000 * sigma[0]:.1f} mm and {np.degrees(sigma[1]):.2f} deg"
    )
    return found
