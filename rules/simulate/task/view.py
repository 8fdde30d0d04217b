"""simulate.view: the camera of policies and films."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, PositiveInt

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.artifacts.tasks.task import View
from dextera_build.geometry import cameras, lie, transforms
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

Point = tuple[float, float, float]


class ViewOptions(Options):
    """Options of simulate.view."""

    width_px: PositiveInt = 128
    """Width of a frame [px]."""
    height_px: PositiveInt = 96
    """Height of a frame [px]."""
    eye_m: Point | None = None
    """Position of the camera in the world [m]; absent: the photograph's camera."""
    target_m: Point | None = None
    """Target of a camera at `eye_m`, in the world [m]; image right is horizontal."""
    samples: Literal[1, 2, 4, 8] = 1
    """Samples per pixel; four give smooth edges, but rendering takes more than twice as long."""
    orbit_deg: float = Field(0.0, ge=-180, le=180)
    """Angle by which the camera is turned about the vertical through the point of the support that it looks at, to see
    the same place from another side [deg]; positive: counterclockwise as seen from above."""
    shift_m: Point = (0.0, 0.0, 0.0)
    """Additional translation in the world [m], as of a bumped camera."""


@rule(version=1, packages=("numpy",), tolerance=Tolerance({"": ROUNDING}))
def view(ctx: Context, scene: Scene, measured: Pose | None = None, *, options: ViewOptions) -> View:
    """Return the photograph's camera, cropped evenly and scaled to the new size, or one at another position.

    Its covariance is that of the calibration `measured` (T_camera_base), because a policy acts in the base's frame;
    without one it is the scene's. A camera placed or turned by hand is exact. The photograph's camera is marked as
    such: if a start draws an error of the base from the same calibration, the camera has no additional error.
    """
    if (options.eye_m is None) != (options.target_m is None):
        ctx.fail("`eye_m` and `target_m` go together", eye_m=options.eye_m, target_m=options.target_m)
    camera = scaled(scene.camera, options.width_px, options.height_px)
    pose = scene.camera_pose if measured is None else _calibrated(scene.camera_pose, measured)
    if options.eye_m is not None and options.target_m is not None:
        placed = cameras.look_at(np.array(options.eye_m), np.array(options.target_m))
        pose = Pose(parent="world", child="camera", matrix=placed)
    if options.orbit_deg:
        pose = Pose(parent="world", child="camera", matrix=_orbited(ctx, pose.matrix, options.orbit_deg))
    if any(options.shift_m):
        moved = transforms.rigid(pose.matrix[:3, :3], pose.matrix[:3, 3] + options.shift_m)
        pose = Pose(parent="world", child="camera", matrix=moved)
    own = options.eye_m is None and not options.orbit_deg and not any(options.shift_m)
    ctx.say(f"{camera.width} x {camera.height} px, {'as photographed' if own else 'placed by hand'}")
    return View(camera=camera, camera_pose=pose, samples=options.samples, photographed=own)


def _orbited(ctx: Context, world_from_camera: np.ndarray, angle_deg: float) -> np.ndarray:
    """A camera turned about the vertical through the point where its axis meets the support, z = 0."""
    eye, axis = world_from_camera[:3, 3], world_from_camera[:3, 2]
    if axis[2] > -1e-3:
        ctx.fail("the camera looks at no point of the support, about which it could be turned", orbit_deg=angle_deg)
    centre = eye - axis * (eye[2] / axis[2])
    turn = transforms.rigid(lie.rotation(np.array([0.0, 0.0, np.radians(angle_deg)])), np.zeros(3))
    there = transforms.rigid(np.eye(3), centre)
    return np.asarray(there @ turn @ transforms.invert(there) @ world_from_camera)


def _calibrated(pose: Pose, measured: Pose) -> Pose:
    """T_world_camera with the covariance that follows from an exact base and T_camera_base."""
    base = Pose(parent=pose.parent, child=measured.child, matrix=pose.matrix @ measured.matrix)
    return pose.model_copy(update={"covariance": (base @ measured.inverse()).covariance})


def scaled(camera: Camera, width: int, height: int) -> Camera:
    """`camera` cropped evenly on two sides to the shape `width` : `height`, then scaled to that size [px].

    Pixel centres are integers, so the left border of the image is at -0.5 before and after.
    """
    scale = max(width / camera.width, height / camera.height)
    left, top = (camera.width - width / scale) / 2, (camera.height - height / scale) / 2
    return Camera(
        width=width,
        height=height,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5 - left) * scale - 0.5,
        cy=(camera.cy + 0.5 - top) * scale - 0.5,
    )
