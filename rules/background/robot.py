"""background.robot: the pixels of a calibrated robot in the photograph."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.cameras.camera import Camera, Measured
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.geometry import robot_mask
from dextera_build.rule import Context, Options, rule


class RobotOptions(Options):
    """Options of background.robot."""

    joints_deg: dict[str, float] = Field(default_factory=dict)
    """Joint -> encoder reading when the photograph was taken [deg]; others are at home."""
    tolerance_m: PositiveFloat = 0.03
    """Maximum difference of measured and rendered depth on the robot [m]; with `measured` only."""
    grow_px: NonNegativeInt = 8
    """Distance outside the rendered outline within which measured pixels may be the robot's [px]; with `measured`
    only."""


class RobotBackend(Protocol):
    """Interface of a backend of background.robot."""

    def mask(
        self, ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Any
    ) -> np.ndarray:
        """Pixels (H, W) bool of the robot at `joints` [rad], its base at T_camera_base (4, 4)."""
        ...

    def depth(
        self, ctx: Context, robot: RobotModel, camera: Camera, base: np.ndarray, joints: dict[str, float], options: Any
    ) -> np.ndarray:
        """Depth (H, W) of the same [m]; 0 outside the robot."""
        ...


@rule(version=1, packages=("numpy",))
def robot(
    ctx: Context[RobotBackend],
    robot: RobotModel,
    camera: Camera,
    mount: Pose,
    measured: Measured | None = None,
    *,
    options: RobotOptions | None = None,
) -> LabelImage:
    """Return 1 at the pixels of the robot, from its model, its joint positions and T_camera_base; otherwise 0.

    With measured depth, pixels just outside the outline with the robot's depth are added, and pixels inside it with
    another depth are removed, as in `align.robot_camera`.
    """
    options = options or RobotOptions()
    known = {joint.name: joint.home for joint in robot.joints}
    if unknown := sorted(set(options.joints_deg) - set(known)):
        ctx.fail(f"the robot has no joint `{unknown[0]}`", joints=listing(known))
    joints = {**known, **{name: float(np.radians(angle)) for name, angle in options.joints_deg.items()}}
    seen = ctx.backend.mask(ctx, robot, camera, mount.matrix, joints, ctx.backend_options)
    if measured is not None:
        rendered = ctx.backend.depth(ctx, robot, camera, mount.matrix, joints, ctx.backend_options)
        depth = measured.depth.depth.astype(np.float64)
        near = robot_mask.near(rendered, seen.astype(np.int32), depth, options.tolerance_m, options.grow_px)
        seen = (near > 0) | (seen & (depth <= 0))
    ctx.metric("robot", 100.0 * float(seen.mean()), "%")
    ctx.say(f"the robot covers {seen.mean():.0%} of the picture" if seen.any() else "the robot is out of the picture")
    return LabelImage(labels=seen.astype(np.int32))
