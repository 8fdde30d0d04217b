"""align.hand_eye: where a camera is beside a robot or on its hand, from pictures of a board."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.calibration import Board, Calibration
from dextera_build.artifacts.robot import RobotModel
from dextera_build.artifacts.robot_views import RobotViews
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class HandEyeOptions(Options):
    """Options of align.hand_eye: what a calibration must reach."""

    effector_frame: str = ""
    """Frame or link of the robot that the board or the camera is on; empty: the one that the capture names."""
    least_views: PositiveInt = Field(5, ge=3)
    """Pictures that must agree with one another."""
    most_bad: int = Field(2, ge=0)
    """Pictures that may contradict the others and are left out, by name."""
    least_turn_deg: PositiveFloat = 5.0
    """Rotation between pictures about a second axis, root mean square, below which the motion does not do [deg]."""
    most_corner_px: PositiveFloat = 3.0
    """Root mean square distance of a picture's corners from a flat board above which it is not that board [px]."""
    most_residual_m: PositiveFloat = 0.01
    """Residual of the chain of poses, root mean square, above which the result is refused [m]."""
    most_residual_deg: PositiveFloat = 2.0
    """The same for its rotation [deg]."""
    most_sigma_m: PositiveFloat = 0.02
    """Standard deviation of the camera's place above which the result is refused [m]."""
    joint_sigma_deg: NonNegativeFloat = 0.05
    """Standard deviation of the zero of each arm joint's encoder, for the covariance where joints are known [deg]."""
    board_size_fraction: PositiveFloat = 0.03
    """Relative difference of the board's size from the stated one that is refused, if the data are sure of it."""


class HandEyeBackend(Protocol):
    """What a backend of align.hand_eye defines."""

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
    Tsai and Lenz 1989, solved jointly for camera and board). Motion that leaves the answer open, a board of
    another size, and pictures that contradict the others are refused or named.
    """
    options = options or HandEyeOptions()
    if views.board is None:
        ctx.fail("the capture states no board", hint="describe the board in the capture's `target`")
    found = ctx.backend.solve(ctx, views, views.board, robot, options, ctx.backend_options)
    rms = (0.0, 0.0)
    if found.residuals is not None and len(found.residuals):
        distance, angle = np.sqrt((found.residuals**2).mean(axis=0))
        rms = 1000 * float(distance), float(np.degrees(angle))
    sigma = found.sigma() or (0.0, 0.0)
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
