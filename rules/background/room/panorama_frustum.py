"""background.panorama without a model: the photograph in its field of view, smooth colours elsewhere."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from dextera_build.rule import Backend, Context, Options

from ..synthesis import membrane
from .sphere import level, warped

BACKEND = Backend(
    summary="the photograph in its frustum, smooth colours from its border elsewhere",
    profiles=("cpu",),
    packages=("opencv-python-headless",),
    extra="twin",
)


class FrustumOptions(Options):
    """Options of backend `frustum` of background.panorama."""

    height_px: int = Field(1024, ge=32, le=8192)
    """Rows of the panorama; it has twice as many columns [px]."""


def widen(ctx: Context, background: Background, camera: Camera, support: Support, options: FrustumOptions) -> Panorama:
    """The photograph in a levelled panorama; unseen pixels are interpolated smoothly from the seen border.

    The interpolation is continuous around the back. `seen` is exact.
    """
    pose = support.camera_pose.matrix
    turn = level(pose)
    picture, seen = warped(background.image.pixels, camera, pose[:3, :3].T @ turn, options.height_px)
    half = options.height_px
    around = np.pad(picture.astype(np.float32), ((0, 0), (half, half), (0, 0)), mode="wrap")
    filled = membrane(around, np.pad(seen, ((0, 0), (half, half)), mode="wrap"))[:, half:-half]
    return Panorama(
        image=Image(pixels=np.where(seen[..., None], picture, np.clip(np.round(filled), 0, 255)).astype(np.uint8)),
        pose=Pose(parent="world", child="camera", matrix=transforms.rigid(turn, pose[:3, 3])),
        seen=seen,
    )
