"""reference.look_at: point the camera of a reference world at its objects from a random viewpoint."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.draw import Viewpoint
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class LookAtOptions(Options):
    """Options of reference.look_at."""

    focal: PositiveFloat = 0.96
    """Focal length as a fraction of the picture's width; 0.96 is that of an Intel RealSense D435 at 640 x 480 px."""
    heading_deg: PositiveFloat = 45.0
    """Largest angle between the heading and the normal view of the wall [deg]."""


@rule(version=1, packages=("numpy",), tolerance=Tolerance({"": ROUNDING}))
def look_at(ctx: Context, world: World, viewpoint: Viewpoint, *, options: LookAtOptions | None = None) -> World:
    """Return the world with a camera that looks at the centre of its objects; intrinsics [px], pose in `reference`."""
    options = options or LookAtOptions()
    heading = np.random.default_rng(viewpoint.seed).uniform(-1, 1) * np.radians(options.heading_deg)
    points = [
        transforms.apply(thing.pose.matrix, thing.surface.vertices.astype(np.float64))
        for thing in world.objects.values()
    ]
    ctx.check(bool(points), "the world has no things to look at", hint="draw more things, or another scene")
    middle = np.mean([(own.min(axis=0) + own.max(axis=0)) / 2 for own in points], axis=0)
    pose = cameras.look_down(
        middle, viewpoint.distance_m, float(heading), np.radians(viewpoint.pitch_deg), np.radians(viewpoint.roll_deg)
    )
    width, height = viewpoint.width_px, round(0.75 * viewpoint.width_px)
    focal = options.focal * width
    camera = Camera(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)
    ctx.say(f"{viewpoint.distance_m:g} m, pitch {viewpoint.pitch_deg:g} deg, roll {viewpoint.roll_deg:g} deg")
    placed = Pose(parent="reference", child="camera", matrix=pose)
    return world.model_copy(update={"camera": camera, "camera_pose": placed})
