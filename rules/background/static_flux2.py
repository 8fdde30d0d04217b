"""background.static with a picture painted by FLUX.2; surface, depth and boxes are those of backend `planes`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.camera import Photograph
from dextera_build.artifacts.image import Image
from dextera_build.artifacts.object import Support
from dextera_build.artifacts.scene import Background
from dextera_build.artifacts.view import InstanceMap
from dextera_build.rule import Backend, Context, Fraction, Options

from .holes import hole

if TYPE_CHECKING:
    from .static import StaticOptions

BACKEND = Backend(
    summary="FLUX.2 [klein] paints what objects hid, `planes` does the rest",
    packages=("diffusers", "pillow", "torch", "transformers"),
    extra="models",
    uses=("planes",),
    gpu_gb=20.0,
    cpu=True,
    weights=("flux2_klein",),
    licence="Apache-2.0",
)

_CELL = 16
"""Side of the cells that the model paints whole [px]; width and height are multiples of it."""


class Flux2Options(Options):
    """Options of backend `flux2` of background.static."""

    prompt: str = "the same scene, empty: no objects, no robot, only the bare surface and the background"
    """What the model is asked to paint."""
    dilate: Fraction = 0.025
    """Mask dilation before filling, as a fraction of the image width; covers soft edges and contact shadows."""
    strength: float = Field(1.0, gt=0.0, le=1.0)
    """1 paints from noise; less keeps something of the picture that `planes` filled."""
    steps: int = Field(50, ge=1, le=200)
    """Steps of the sampling."""
    guidance: float = Field(4.0, ge=1.0, le=20.0)
    """Weight of the prompt."""
    longest_px: int = Field(1024, ge=64, le=4096)
    """Longest side that the model paints [px]; larger photographs are reduced for it."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def clean(
    ctx: Context,
    photograph: Photograph,
    depth: np.ndarray,
    support: Support,
    instances: InstanceMap,
    common: StaticOptions,
    options: Flux2Options,
) -> Background:
    """The background of `planes` with the pixels of the hole by FLUX.2 (Black Forest Labs, 2025); others stay."""
    made: Background = ctx.other("planes").clean(photograph, depth, support, instances, common)
    taken = hole(instances, options.dilate)
    if not taken.any():
        return made
    painted = paint(ctx.load(load, "flux2_klein"), made.image.pixels, taken, options)
    image = Image(pixels=np.where(taken[..., None], painted, made.image.pixels))
    return made.model_copy(update={"image": image, "mesh": made.mesh.model_copy(update={"texture": image})})


def self_test(ctx: Context) -> None:
    """The model paints a corner of a grey picture in one step."""
    taken = np.zeros((64, 64), bool)
    taken[:32, :32] = True
    options = Flux2Options(steps=1, longest_px=64)
    paint(ctx.load(load, "flux2_klein"), np.full((64, 64, 3), 128, np.uint8), taken, options)


def load(folder: Path, device: str) -> Any:
    """The pipeline from a folder of weights; bfloat16 on a GPU."""
    import diffusers
    import torch

    library: Any = diffusers  # partly typed
    kind = torch.bfloat16 if device == "cuda" else torch.float32
    pipeline = library.Flux2KleinInpaintPipeline.from_pretrained(folder, dtype=kind, local_files_only=True)
    pipeline.set_progress_bar_config(disable=True)
    return pipeline.to(device)


def paint(pipeline: Any, pixels: np.ndarray, taken: np.ndarray, options: Flux2Options) -> np.ndarray:
    """The picture (H, W, 3) uint8 as the model paints it at the pixels `taken`."""
    import torch
    from PIL import Image as Pillow

    height, width = taken.shape
    factor = min(1.0, options.longest_px / max(height, width))
    size = [max(_CELL, round(side * factor / _CELL) * _CELL) for side in (width, height)]
    answer = pipeline(
        prompt=options.prompt,
        image=Pillow.fromarray(pixels).resize(size, Pillow.Resampling.LANCZOS),
        mask_image=Pillow.fromarray(_cells(taken, size)),
        width=size[0],
        height=size[1],
        strength=options.strength,
        num_inference_steps=options.steps,
        guidance_scale=options.guidance,
        generator=torch.Generator("cpu").manual_seed(options.seed),
    )
    return np.asarray(answer.images[0].convert("RGB").resize((width, height), Pillow.Resampling.LANCZOS))


def _cells(taken: np.ndarray, size: list[int]) -> np.ndarray:
    """The mask (H, W) uint8, 0 or 255, at this width and height: a cell is painted if any pixel of it is taken.

    The pipeline looks at one pixel of each cell only.
    """
    from PIL import Image as Pillow

    small = np.asarray(Pillow.fromarray(taken.astype(np.uint8) * 255).resize(size, Pillow.Resampling.BOX)) > 0
    cells = small.reshape(size[1] // _CELL, _CELL, size[0] // _CELL, _CELL).any(axis=(1, 3))
    return np.repeat(np.repeat(cells.astype(np.uint8) * 255, _CELL, axis=0), _CELL, axis=1)
