"""align.camera_base: pose of the robot's base in the camera frame, from a calibration."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class CameraBaseOptions(Options):
    """align.camera_base has no options."""


@rule(version=1, packages=("numpy",), tolerance=Tolerance({"": ROUNDING}))
def camera_base(ctx: Context, calibration: Calibration, *, options: CameraBaseOptions | None = None) -> Pose:
    """Return T_camera_base [m] with its covariance, which `align.base` and `background.robot` need.

    The frames are named `camera` and `base`, independent of their names in the calibration.
    """
    if calibration.mount != "eye_on_base":
        ctx.fail(
            "the camera of this calibration is on the hand, so the base moves in its picture",
            hint="calibrate a camera next to the robot",
        )
    found = calibration.pose.inverse().model_copy(update={"parent": "camera", "child": "base"})
    sigma = found.sigma()
    told = "" if sigma is None else f", sigma {1000 * sigma[0]:.1f} mm and {np.degrees(sigma[1]):.2f} deg"
    ctx.say(f"base {np.linalg.norm(found.matrix[:3, 3]):.2f} m from the camera{told}")
    return found
