"""align.camera_motion: whether a camera has moved relative to the robot since its calibration."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, moved
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

STATES = ("unmoved", "moved", "unsure")
"""Names of the values 0 to 2 of the metric `verdict`."""


class CameraMotionOptions(Options):
    """Options of align.camera_motion."""

    effector_frame: str = ""
    """As in align.hand_eye."""
    notable_m: PositiveFloat = 0.005
    """Shift of the board that is reported as motion [m]; the answer is `unsure` if the errors could hide such a
    shift."""
    notable_deg: PositiveFloat = Field(0.5, le=180.0)
    """Rotation of the board that is reported as motion [deg]; the same holds for it."""


class MotionBackend(Protocol):
    """Interface of a backend of align.camera_motion."""

    def poses(
        self,
        ctx: Context,
        views: RobotViews,
        robot: RobotModel | None,
        calibration: Calibration,
        frame: str,
        options: Any,
    ) -> tuple[np.ndarray, np.ndarray]:
        """T_camera_board (N, 4, 4) as predicted by calibration and robot, and as measured in the pictures."""
        ...


@rule(version=1, packages=("numpy", "scipy"), tolerance=Tolerance({"": ROUNDING}))
def camera_motion(
    ctx: Context[MotionBackend],
    views: RobotViews,
    calibration: Calibration,
    robot: RobotModel | None = None,
    *,
    options: CameraMotionOptions | None = None,
) -> Pose:
    """Return T_camera_camera_now [m], the place of new pictures' camera in the calibrated one's frame, with covariance.

    The board must be mounted as in the calibration: a board that slipped, a base that moved and a camera that moved
    cannot be distinguished. Errors are assumed to be as large as the residuals of the calibration's own pictures.
    """
    options = options or CameraMotionOptions()
    residuals, board = calibration.residuals, calibration.board_pose
    if residuals is None or len(residuals) < 3 or board is None:
        ctx.fail(
            "the calibration has no residuals or no pose of the board, so the expected residuals are unknown",
            hint="give the result of `align.hand_eye` or `align.robot_camera`",
        )
    ctx.check(
        calibration.mount == views.mount,
        f"the calibration is of `{calibration.mount}`, the pictures are of `{views.mount}`",
        hint="give pictures of the same camera",
    )
    frame = options.effector_frame or calibration.effector_frame
    expected, seen = ctx.backend.poses(ctx, views, robot, calibration, frame, ctx.backend_options)
    verdict = moved.judge(expected, seen, residuals, (options.notable_m, float(np.radians(options.notable_deg))))
    ctx.metric("verdict", float(STATES.index(verdict.state)))
    ctx.metric("shift", 1000 * verdict.shift_m, "mm")
    ctx.metric("rotation", float(np.degrees(verdict.turn_rad)), "deg")
    ctx.metric("chance", verdict.chance)
    ctx.say(
        f"{verdict.state}: the board is {1000 * verdict.shift_m:.1f} mm (sigma {1000 * verdict.sigma_m:.1f}) and "
        f"{np.degrees(verdict.turn_rad):.2f} deg (sigma {np.degrees(verdict.sigma_rad):.2f}) from where the "
        f"calibration has it in {len(seen)} pictures; chance {verdict.chance:.2g} if nothing moved"
    )
    if verdict.state == "moved":
        ctx.warn("camera, base or board moved: calibrate again")
    return _now(verdict, seen)


def _now(verdict: moved.Verdict, seen: np.ndarray) -> Pose:
    """T_camera_camera_now: the inverse of the board's motion in the picture."""
    arm = seen[:, :3, 3].mean(axis=0)
    about = np.diag([verdict.sigma_m**2] * 3 + [verdict.sigma_rad**2] * 3)
    by = lie.adjoint(-arm)  # a rotation about the board also shifts the origin
    motion = Pose(parent="camera_now", child="camera", matrix=verdict.motion, covariance=by @ about @ by.T)
    return motion.inverse()
