"""align.camera: current pose of the camera in a twin, from a new picture of the scene."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from dextera_build.rule import Context, Options, rule


class CameraOptions(Options):
    """Options of align.camera."""

    most_scale: PositiveFloat = 0.02
    """Maximum accepted relative difference between the two pictures' scales."""


@rule(version=1, packages=("numpy",))
def camera(ctx: Context, support: Support, seen: SceneFit, *, options: CameraOptions | None = None) -> Pose:
    """Return T_world_camera [m] of the camera that took the new picture, with its covariance.

    Args:
        ctx: Context.
        support: T_world_camera of the picture from which the twin and the scene of `seen` were made.
        seen: T_camera_scene of the new picture; the scene has the axes and the unit of the old picture's camera.
        options: Options.
    """
    options = options or CameraOptions()
    scale = seen.motion.scale
    ctx.check(
        abs(scale - 1.0) <= options.most_scale,
        f"the new picture's scale is {scale:.3f} times that of the old one",
        believed=f"1 ± {options.most_scale:g}",
        hint="check the depth unit of the new capture; a scene of unknown scale goes through `align.apply`",
    )
    # In the unit of the old picture, which is that of the world.
    now_from_old = transforms.rigid(seen.motion.matrix[:3, :3], seen.motion.matrix[:3, 3] / scale)
    spread = seen.motion.covariance
    motion = Pose(
        parent="now",
        child="camera",
        matrix=now_from_old,
        covariance=None if spread is None else np.ascontiguousarray(spread[:6, :6]),
    )
    # The old picture defines the world, so its own uncertainty does not enter.
    old = support.camera_pose.model_copy(update={"covariance": None})
    found = (old @ motion.inverse()).model_copy(update={"child": "camera"})
    moved = transforms.invert(now_from_old)
    distance, angle = float(np.linalg.norm(moved[:3, 3])), float(np.degrees(transforms.angle(moved[:3, :3])))
    ctx.metric("moved", 1000 * distance, "mm")
    ctx.metric("turned", angle, "deg")
    ctx.say(f"the camera is {1000 * distance:.1f} mm and {angle:.2f} deg from where the twin's picture was taken")
    return found
