"""reference.move_camera: a reference world with a displaced camera, as after a knock against its stand."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import World
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Context, Options, rule


class MoveCameraOptions(Options):
    """Options of reference.move_camera; nothing moves by default."""

    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the camera along its own axes: right, down, forward [m]."""
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector of the camera in its own axes [deg]."""


@rule(version=1, packages=("numpy",))
def move_camera(ctx: Context, world: World, *, options: MoveCameraOptions | None = None) -> World:
    """Return the same world, seen from T_world_camera @ (shift, turn) [m]."""
    options = options or MoveCameraOptions()
    turn, shift = np.radians(options.turn_deg), np.array(options.shift_m, np.float64)
    motion = transforms.rigid(lie.rotation(turn), shift)
    pose = world.camera_pose.model_copy(update={"matrix": world.camera_pose.matrix @ motion})
    ctx.say(f"camera moved by {1000 * np.linalg.norm(shift):.1f} mm and {np.linalg.norm(options.turn_deg):.2f} deg")
    return world.model_copy(update={"camera_pose": pose})
