"""Backend `flux2` of factorize.complete: FLUX.2 inpaints the occluded region, and GrabCut segments the object in it."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt

from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.learning.flux2 import load, paint
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(
    summary="FLUX.2 [klein] inpaints the hidden part, GrabCut segments the object in it",
    packages=("diffusers", "numpy", "opencv-python-headless", "pillow", "scipy", "torch", "transformers"),
    extra="models",
    gpu_gb=20.0,
    cpu=True,
    weights=("flux2_klein",),
    licence="Apache-2.0",
)


class Flux2Options(Options):
    """Options of backend `flux2` of factorize.complete."""

    prompt: str = "a photograph of {phrase}, whole and unobstructed"
    """Prompt of the model; `{phrase}` is the phrase of the object."""
    strength: float = Field(1.0, gt=0.0, le=1.0)
    """1 paints from pure noise; lower values keep more of the occluder."""
    steps: int = Field(50, ge=1, le=200)
    """Number of sampling steps."""
    guidance: float = Field(4.0, ge=1.0, le=20.0)
    """Guidance scale of the prompt."""
    longest_px: int = Field(768, ge=64, le=4096)
    """Longest side of the inpainted crop [px]; the crop is resized to it."""
    rounds: PositiveInt = 5
    """GrabCut iterations."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def complete(ctx: Context, view: ObjectView, options: Flux2Options) -> tuple[np.ndarray, np.ndarray]:
    """The occluder's pixels inpainted by FLUX.2 (Black Forest Labs, 2025), given phrase and visible pixels."""
    prompt = options.prompt.replace("{phrase}", view.phrase)
    alone = np.where(view.mask[..., None], view.rgb.pixels, np.uint8(255))
    pipeline, hidden = ctx.load(load, "flux2_klein"), view.occluder & ~view.mask
    painted = paint(pipeline, view.rgb.pixels, hidden, prompt, options, options.longest_px, alone)
    pixels = np.where(hidden[..., None], painted, view.rgb.pixels)
    return pixels, whole(pixels, view.mask, hidden, options.rounds)


def self_test(ctx: Context) -> None:
    """Check that the model inpaints a corner of a grey picture in one step."""
    taken = np.zeros((64, 64), bool)
    taken[:32, :32] = True
    grey = np.full((64, 64, 3), 128, np.uint8)
    paint(ctx.load(load, "flux2_klein"), grey, taken, "a mug", Flux2Options(steps=1), 64, grey)


def whole(pixels: np.ndarray, mask: np.ndarray, hidden: np.ndarray, rounds: int) -> np.ndarray:
    """The mask (H, W) bool of the whole object in a completed picture.

    Rother, Kolmogorov, Blake: GrabCut, SIGGRAPH 2004. Visible pixels are foreground, all others background; hidden
    pixels that GrabCut assigns to the object and that are connected to it are added.

    Args:
        pixels: (H, W, 3) uint8 sRGB, hidden pixels painted.
        mask: (H, W) bool, visible pixels of the object.
        hidden: (H, W) bool, painted pixels.
        rounds: Number of iterations.
    """
    import cv2
    from scipy import ndimage

    if not hidden.any() or (mask | hidden).all():
        return mask
    cv2.setNumThreads(1)
    cv2.setRNGSeed(0)  # the colour models are initialised by k-means
    # Learned from visible pixels alone: hidden pixels take the colour and the label of the nearest visible one.
    nearest = tuple(ndimage.distance_transform_edt(hidden, return_distances=False, return_indices=True))
    models = np.zeros((1, 65)), np.zeros((1, 65))
    known = np.where(mask, cv2.GC_FGD, cv2.GC_BGD).astype(np.uint8)
    bgr = np.ascontiguousarray(pixels[..., ::-1])
    cv2.grabCut(bgr[nearest], known[nearest], None, *models, rounds, cv2.GC_INIT_WITH_MASK)
    labels = np.where(hidden, cv2.GC_PR_FGD, known).astype(np.uint8)
    cv2.grabCut(bgr, labels, None, *models, 1, cv2.GC_EVAL_FREEZE_MODEL)
    found = ndimage.binary_opening((labels == cv2.GC_PR_FGD) | mask, np.ones((3, 3), bool)) | mask
    parts, _ = ndimage.label(found)
    return np.asarray(mask | (hidden & np.isin(parts, np.unique(parts[mask]))))
