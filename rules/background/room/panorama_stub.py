"""background.panorama in one colour: the mean of the photograph, with no pixel marked as seen."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="one colour in all directions", profiles=("stub",))


def widen(ctx: Context, background: Background, camera: Camera, support: Support, options: Options) -> Panorama:
    """The mean colour of the photograph in all directions, 32 x 16 px, in the camera's orientation."""
    colour = background.image.pixels.mean(axis=(0, 1)).round().astype(np.uint8)
    pixels = np.broadcast_to(colour, (16, 32, 3)).copy()
    return Panorama(image=Image(pixels=pixels), pose=support.camera_pose, seen=np.zeros((16, 32), bool))
