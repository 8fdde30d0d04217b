"""evaluate.overlay: the photograph and the rendered twin, side by side and blended."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.geometry import metrics
from dextera_build.rule import Context, Fraction, Options, rule

from .panels import board


class OverlayOptions(Options):
    """Options of evaluate.overlay."""

    blend: Fraction = 0.5
    """Weight of the twin in the blended picture, 0..1."""


class OverlayBackend(Protocol):
    """Interface of a backend of evaluate.overlay."""

    def render(self, ctx: Context, scene: Scene, options: Any) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """The twin as a stock renderer shows it, without custom flags or lights.

        Returns:
            Colours (H, W, 3) uint8 through camera `capture`; the index of each pixel's object in `bodies` and `held` of
            the scene, (H, W) int32, or -1; side -> colours from that side, of the same size, with all objects in full
            view.
        """
        ...


@rule(version=4)
def overlay(ctx: Context[OverlayBackend], photograph: Photograph, scene: Scene, *, options: OverlayOptions) -> Image:
    """Return pictures from the photograph's camera: photograph, twin, blend, outlines; then pictures from other sides.

    The twin is rendered in keyframe `home` by a stock renderer. Outlines carry the objects' names, and `(held)` for
    those that are fixed because they would not rest, see `simulate.steady`.
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
    twin, owner, sides = ctx.backend.render(ctx, scene, ctx.backend_options)
    ctx.check(twin.shape == photograph.rgb.pixels.shape, "the render has another size than the photograph")
    names = (*scene.bodies, *scene.held)
    shown = sum(bool((owner == number).any()) for number in range(len(names)))
    ctx.metric("objects in view", shown, f"of {len(names)}")
    likeness = metrics.psnr(twin, photograph.rgb.pixels, np.ones(size, bool))
    if likeness is not None:
        ctx.metric("PSNR", likeness, "dB")
    ctx.say(
        f"{shown} of {len(names)} objects in view"
        + (f", {likeness:.1f} dB from the photograph" if likeness is not None else "")
    )
    titles = (*scene.bodies, *(f"{name} (held)" for name in scene.held))
    picture = board(photograph.rgb.pixels, twin, owner, titles, options.blend, sides)
    ctx.preview(picture, "photograph, twin, blend, outlines, four other sides")
    return Image(pixels=picture)
