"""evaluate.room: the twin's objects in the room of Gaussians, compared with the photograph."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from PIL import Image as Pillow
from PIL.Image import Resampling
from pydantic import Field

from dextera_build.artifacts.cameras.camera import Camera, Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.scenes.scene_fit import AlignedScene
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.geometry import metrics
from dextera_build.rule import Context, Options, rule

from .panels import beside, titled


class RoomOptions(Options):
    """Options of evaluate.room."""

    longest_px: int = Field(640, ge=16, le=4096)
    """Longest side of the pictures [px]; Gaussians have gaps in pictures with a higher resolution than their views."""


class RoomBackend(Protocol):
    """Interface of a backend of evaluate.room."""

    def render(
        self, ctx: Context, scene: Scene, room: Splats, camera: Camera, world_from_camera: np.ndarray, options: Any
    ) -> np.ndarray:
        """The objects of the scene in keyframe `home` among the Gaussians, (H, W, 3) uint8 sRGB."""
        ...


@rule(version=1, packages=("numpy", "pillow"))
def room(
    ctx: Context[RoomBackend], photograph: Photograph, scene: Scene, room: Room | AlignedScene, *, options: RoomOptions
) -> Image:
    """Return the photograph next to the twin's objects among the room's Gaussians, from the photograph's camera.

    The room is that of `background.compose`, or a generated one in the world of the twin, of `align.apply`.
    """
    splats = room.splats
    if splats is None:
        ctx.fail("the room has no Gaussians", hint="give `align.apply` the input `splats`")
    whole = photograph.camera
    camera = whole.scaled(min(1.0, options.longest_px / max(whole.width, whole.height)))
    shot = np.asarray(Pillow.fromarray(photograph.rgb.pixels).resize((camera.width, camera.height), Resampling.BOX))
    ctx.check(splats.frame == "world", "the room is not in the frame of the scene", frame=splats.frame)
    pixels: np.ndarray = ctx.backend.render(ctx, scene, splats, camera, scene.camera_pose.matrix, ctx.backend_options)
    ctx.check(pixels.shape == shot.shape, "the render does not have the size of the camera")
    likeness = metrics.psnr(shot, pixels, np.ones(shot.shape[:2], bool))
    if likeness is not None:
        ctx.metric("likeness", likeness, "dB")
    told = "as the photograph" if likeness is None else f"{likeness:.1f} dB from the photograph"
    objects = "1 object" if len(scene.bodies) == 1 else f"{len(scene.bodies)} objects"
    ctx.say(f"{objects} among {len(splats.means):,} Gaussians, {told}")
    panes = [titled(shot, "photograph"), titled(pixels, "twin, the room as Gaussians")]
    picture = beside(panes[0], panes[1], axis=1)
    ctx.preview(picture, "photograph, and the twin's objects in the room")
    return Image(pixels=picture)
