"""background.static with inpainting by FLUX.2; surface, depth and boxes are those of backend `planes`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.learning.flux2 import load, paint
from dextera_build.rule import Backend, Context, Fraction, Options

from .behind import Behind
from .holes import hole
from .pieces import bordered

if TYPE_CHECKING:
    from .static import StaticOptions

BACKEND = Backend(
    summary="FLUX.2 [klein] inpaints the areas hidden by objects, `planes` does the rest",
    packages=("diffusers", "pillow", "torch", "transformers"),
    extra="models",
    uses=("planes",),
    gpu_gb=20.0,
    cpu=True,
    weights=("flux2_klein",),
    licence="Apache-2.0",
)


class Flux2Options(Options):
    """Options of backend `flux2` of background.static."""

    prompt: str = "the same scene, empty: no objects, no robot, only the bare surface and the background"
    """Prompt of the model."""
    dilate: Fraction = 0.025
    """Mask dilation before filling, as a fraction of the image width; covers soft edges and contact shadows."""
    strength: float = Field(1.0, gt=0.0, le=1.0)
    """1 paints from pure noise; lower values keep more of the picture filled by `planes`."""
    steps: int = Field(50, ge=1, le=200)
    """Number of sampling steps."""
    guidance: float = Field(4.0, ge=1.0, le=20.0)
    """Guidance scale of the prompt."""
    longest_px: int = Field(1024, ge=64, le=4096)
    """Longest side of the inpainted picture [px]; larger photographs are reduced."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def clean(
    ctx: Context,
    photograph: Photograph,
    depth: np.ndarray,
    support: Support,
    instances: InstanceMap,
    robot: np.ndarray,
    behind: Behind | None,
    common: StaticOptions,
    options: Flux2Options,
) -> Background:
    """The background of `planes` with pixels of the hole by FLUX.2 (Black Forest Labs, 2025).

    Pixels that a further photograph shows, and all others, are kept.
    """
    made: Background = ctx.other("planes").clean(photograph, depth, support, instances, robot, behind, common)
    taken = hole(instances, robot, options.dilate)
    if behind is not None:
        taken &= ~behind.mask
    if not taken.any():
        return made
    longest = min(options.longest_px, max(taken.shape))
    painted = paint(ctx.load(load, "flux2_klein"), made.image.pixels, taken, options.prompt, options, longest)
    image = Image(pixels=np.where(taken[..., None], painted, made.image.pixels))
    texture = Image(pixels=bordered(image.pixels))
    return made.model_copy(update={"image": image, "mesh": made.mesh.model_copy(update={"texture": texture})})


def self_test(ctx: Context) -> None:
    """Check that the model inpaints a corner of a grey picture in one step."""
    taken = np.zeros((64, 64), bool)
    taken[:32, :32] = True
    grey, options = np.full((64, 64, 3), 128, np.uint8), Flux2Options(steps=1)
    paint(ctx.load(load, "flux2_klein"), grey, taken, options.prompt, options, 64)
