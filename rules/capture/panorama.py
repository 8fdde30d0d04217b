"""capture.panorama: read an equirectangular panorama."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.image import Image
from dextera_build.artifacts.panorama import Panorama
from dextera_build.artifacts.pose import Pose
from dextera_build.rule import Context, Options, rule

from .pictures import pixels


class PanoramaOptions(Options):
    """Options of capture.panorama."""

    frame: str = "world"
    """Frame of the pose if none is given: the panorama's position is its origin, with z up and x ahead."""


AHEAD = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""T_world_camera of a camera that looks along x with z up."""


@rule(version=1, packages=("numpy", "pillow"))
def panorama(ctx: Context, file: File, pose: Pose | None = None, *, options: PanoramaOptions) -> Panorama:
    """Return an equirectangular PNG or JPEG, twice as wide as high, with the pose of its camera."""
    found = pixels(ctx, file.data, "panorama", "RGB")
    height, width = found.shape[:2]
    if width != 2 * height:
        ctx.fail(
            "the picture is not twice as wide as high, so it does not show all directions",
            size=f"{width} x {height} px",
            hint="pad it with black to 360 x 180 degrees",
        )
    ctx.say(f"{width} x {height} px")
    ctx.preview(found, "panorama")
    return Panorama(image=Image(pixels=found), pose=pose or Pose(parent=options.frame, child="camera", matrix=AHEAD))
