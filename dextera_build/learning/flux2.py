"""FLUX.2 [klein]: loading of the pipeline, and inpainting, shared by backends of several stages."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np

CELL_PX = 16
"""Side of the cells that the model inpaints as a whole [px]; width and height are multiples of it."""


class Painting(Protocol):
    """Settings of inpainting, provided by a backend's options."""

    @property
    def strength(self) -> float:
        """1 paints from pure noise; lower values keep more of the picture."""

    @property
    def steps(self) -> int:
        """Number of sampling steps."""

    @property
    def guidance(self) -> float:
        """Guidance scale of the prompt."""

    @property
    def seed(self) -> int:
        """Seed of the sampling."""


def load(folder: Path, device: str) -> Any:
    """Load the pipeline from a folder of weights; bfloat16 on a GPU."""
    import diffusers
    import torch

    library: Any = diffusers  # partly typed
    kind = torch.bfloat16 if device == "cuda" else torch.float32
    pipeline = library.Flux2KleinInpaintPipeline.from_pretrained(folder, dtype=kind, local_files_only=True)
    pipeline.set_progress_bar_config(disable=True)
    return pipeline.to(device)


def paint(
    pipeline: Any,
    pixels: np.ndarray,
    taken: np.ndarray,
    prompt: str,
    how: Painting,
    longest_px: int,
    reference: np.ndarray | None = None,
) -> np.ndarray:
    """The picture with some of its pixels inpainted by the model (Black Forest Labs, 2025).

    Args:
        pipeline: From `load`.
        pixels: (H, W, 3) uint8 sRGB.
        taken: (H, W) bool, pixels to inpaint; the others are returned nearly unchanged.
        prompt: Prompt of the model.
        how: Sampling settings.
        longest_px: Longest side of the model's input [px]; the picture is resized to it.
        reference: (h, w, 3) uint8 sRGB, a reference picture.

    Returns:
        (H, W, 3) uint8 sRGB.
    """
    import torch
    from PIL import Image as Pillow

    height, width = taken.shape
    factor = longest_px / max(height, width)
    size = [max(CELL_PX, round(side * factor / CELL_PX) * CELL_PX) for side in (width, height)]
    answer = pipeline(
        prompt=prompt,
        image=Pillow.fromarray(pixels).resize(size, Pillow.Resampling.LANCZOS),
        mask_image=Pillow.fromarray(_cells(taken, size)),
        image_reference=None if reference is None else Pillow.fromarray(reference).resize(size),
        width=size[0],
        height=size[1],
        strength=how.strength,
        num_inference_steps=how.steps,
        guidance_scale=how.guidance,
        generator=torch.Generator("cpu").manual_seed(how.seed),
    )
    return np.asarray(answer.images[0].convert("RGB").resize((width, height), Pillow.Resampling.LANCZOS))


def _cells(taken: np.ndarray, size: list[int]) -> np.ndarray:
    """The mask (h, w) uint8, 0 or 255, at this size: a cell is inpainted if any pixel of it is.

    The pipeline samples only one pixel of each cell.
    """
    from PIL import Image as Pillow

    small = np.asarray(Pillow.fromarray(taken.astype(np.uint8) * 255).resize(size, Pillow.Resampling.BOX)) > 0
    cells = small.reshape(size[1] // CELL_PX, CELL_PX, size[0] // CELL_PX, CELL_PX).any(axis=(1, 3))
    return np.repeat(np.repeat(cells.astype(np.uint8) * 255, CELL_PX, axis=0), CELL_PX, axis=1)
