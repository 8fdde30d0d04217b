"""evaluate.overlay: the photograph and the rendered twin, side by side and blended."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from dextera_build.artifacts.camera import Photograph
from dextera_build.artifacts.image import Image
from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Context, Fraction, Options, rule

from .panels import board

if TYPE_CHECKING:
    import numpy as np


class OverlayOptions(Options):
    """Options of evaluate.overlay."""

    blend: Fraction = 0.5
    """Weight of the twin in the blended picture, 0..1."""


class OverlayBackend(Protocol):
    """What a backend of evaluate.overlay defines."""

    def render(self, ctx: Context, scene: Scene, options: Any) -> tuple[np.ndarray, np.ndarray]:
        """Colours (H, W, 3) uint8 and, per pixel, its place in `bodies` and `held` (H, W) int32, or -1."""
        ...


@rule(version=2)
def overlay(ctx: Context[OverlayBackend], photograph: Photograph, scene: Scene, *, options: OverlayOptions) -> Image:
    """Return four pictures from the photograph's camera: photograph, twin, blend, and the twin's outlines on the photo.

    The twin is rendered in keyframe `home` over the cleaned photograph.
    """
    camera = scene.camera
    size = photograph.rgb.pixels.shape[:2]
    if size != (camera.height, camera.width):
        ctx.fail(
            "the scene's camera is not the photograph's",
            photograph=f"{size[1]} x {size[0]} px",
            scene=f"{camera.width} x {camera.height} px",
        )
    twin: np.ndarray
    owner: np.ndarray
    twin, owner = ctx.backend.render(ctx, scene, ctx.backend_options)
    ctx.check(twin.shape == photograph.rgb.pixels.shape, "the render has another size than the photograph")
    names = (*scene.bodies, *scene.held)
    shown = sum(bool((owner == number).any()) for number in range(len(names)))
    ctx.metric("objects in view", shown, f"of {len(names)}")
    ctx.say(f"{shown} of {len(names)} objects in view")
    picture = board(photograph.rgb.pixels, twin, owner, names, options.blend)
    ctx.preview(picture, "photograph, twin, blend, outlines")
    return Image(pixels=picture)
