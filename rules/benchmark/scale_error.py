"""benchmark.scale_error: errors of the alignment of a lifted scene in a reference world."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.draw import Viewpoint
from dextera_build.artifacts.scenes.scene_fit import SceneFit
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.table import Table
from dextera_build.geometry import transforms
from dextera_build.rule import Context, rule

from . import errors


@rule(version=2, packages=("numpy", "scipy"))
def scale_error(ctx: Context, world: World, moved: World, fit: SceneFit, viewpoint: Viewpoint) -> Table:
    """Return the errors of scale [%], of the second camera's position [mm] and of its rotation [deg].

    Args:
        ctx: Context.
        world: The world of the picture that the scene was lifted from.
        moved: The same world with the camera of the picture that was aligned.
        fit: T_camera_scene of that picture.
        viewpoint: Its `unit` is the unit of the lifted scene.
    """
    true = transforms.invert(moved.camera_pose.matrix) @ world.camera_pose.matrix
    motion, ratio = fit.motion, fit.motion.scale * viewpoint.unit
    spread = None if motion.covariance is None else motion.covariance[6:, 6:]
    scale = float(np.log(ratio))
    # The camera in the scene at its true size, so that the position error excludes the scale error.
    place = transforms.invert(motion.matrix)[:3, 3] / ratio - transforms.invert(true)[:3, 3]
    turn = errors.off(motion.matrix, true)[3:]
    distance, angle = 1000 * float(np.linalg.norm(place)), float(np.degrees(np.linalg.norm(turn)))
    ctx.say(f"scale {100 * scale:+.2f} %, camera {distance:.1f} mm and {angle:.2f} deg off")
    region = errors.inside(np.array([scale]), spread)
    rows: list[errors.Row] = [
        ("", "scene scale", "%", 100 * abs(scale), region),
        ("", "scene camera", "mm", distance, None),
        ("", "scene camera angle", "deg", angle, None),
    ]
    believed = [("", "scene scale, believed", "%", 100 * abs(scale), region)] if not fit.doubts else []
    return errors.table(
        "An aligned scene against the truth",
        rows + believed,
        (
            "scene: its lengths are of a unit that align.scene does not know; scale: logarithm of found over true; "
            "camera: of the second picture in the scene at its true size; believed: without doubts",
        ),
    )
