"""align.base: pose of the robot's base in the twin."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Context, Options, rule


class BaseOptions(Options):
    """Options of align.base: the robot's pose without a calibration."""

    position_m: tuple[float, float, float] | None = None
    """Origin of the base in the twin's world [m]; ignored if measured."""
    yaw_deg: float = 0.0
    """Rotation of the base about z [deg]; ignored if measured."""


@rule(version=1, packages=("numpy",))
def base(
    ctx: Context,
    support: Support,
    measured: Pose | None = None,
    camera: Pose | None = None,
    *,
    options: BaseOptions | None = None,
) -> Pose:
    """Return T_world_base [m] in the twin's world: T_world_camera @ T_camera_base if the latter was measured.

    T_world_camera is that of the twin's picture, `support.camera_pose`, or, if the camera has been moved since,
    `camera` of `align.camera`.
    """
    options = options or BaseOptions()
    if measured is None:
        if options.position_m is None:
            ctx.fail(
                "the robot's base has no pose",
                hint="give input `measured` from a robot-camera calibration, or option `position_m`",
            )
        turn = lie.rotation(np.array([0.0, 0.0, np.radians(options.yaw_deg)]))
        placed = Pose(parent="world", child="base", matrix=transforms.rigid(turn, np.array(options.position_m)))
        ctx.say(f"{_place(placed.matrix)}, chosen")
        return placed
    frames = (measured.parent, measured.child)
    ctx.check(
        frames == ("camera", "base"),
        f"the measured transform is T_{frames[0]}_{frames[1]}, but T_camera_base is needed",
        hint="take it from `align.camera_base`",
    )
    ctx.check(
        support.scale != "unknown",
        "the scale of this twin is unknown, so a measured pose has no place in it",
        hint="give the pose as input `robot` of `align.support`, or state one size, see `align.scale`",
    )
    placed = (support.camera_pose if camera is None else camera) @ measured
    lean = float(np.degrees(np.arccos(np.clip(placed.matrix[2, 2], -1.0, 1.0))))
    ctx.metric("base height", 1000 * float(placed.matrix[2, 3]), "mm")
    ctx.metric("base lean", lean, "deg")
    ctx.say(f"{_place(placed.matrix)}, leaning {lean:.2f} deg, measured")
    return placed


def _place(matrix: np.ndarray) -> str:
    x, y, z = (float(value) + 0.0 for value in matrix[:3, 3])
    yaw = float(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])))
    return f"base at {x:.3f}, {y:.3f}, {z:.3f} m, yaw {yaw:.1f} deg"
