"""Masks from the photograph alone: GrabCut from the box of every element."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveInt

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.rule import Backend, Context, Fraction, Options

from ..measured import Measurements, Workspace
from ..overlap import Box

BACKEND = Backend(
    summary="GrabCut from the elements' boxes; nothing measured is read",
    packages=("numpy", "scipy", "opencv-python-headless"),
    extra="twin",
)


class GrabcutOptions(Options):
    """Options of backend `grabcut` of factorize.segment."""

    rounds: PositiveInt = 5
    """GrabCut iterations."""
    surround: float = Field(0.2, gt=0.0, le=2.0)
    """Width of the surroundings from which background colours are learned, as a fraction of the element's box."""
    smallest_part: Fraction = 0.05
    """Parts of a mask smaller than this fraction of its largest part are dropped."""


def masks(
    ctx: Context,
    photograph: Photograph,
    measured: Measurements[Workspace],
    elements: Elements,
    options: GrabcutOptions,
) -> dict[str, np.ndarray]:
    """Element -> mask (H, W) bool, in the elements' order; static elements too, because they hide things.

    Rother, Kolmogorov, Blake: GrabCut, SIGGRAPH 2004. A pixel in two masks belongs to the one with the smaller box,
    because small objects are more often in front of or on large ones than behind them.
    """
    boxed = [element for element in elements.elements if element.box is not None]
    if not boxed:
        ctx.fail(
            "no element has a box to cut out",
            hint="give each element of `scene.yaml` a `box`, or choose a backend of `factorize.parse` that finds them",
        )
    found: dict[str, np.ndarray] = {}
    height, width = photograph.rgb.pixels.shape[:2]
    for element in boxed:
        assert element.box is not None
        if element.box[0] >= width or element.box[1] >= height:
            ctx.fail(
                f"the box of `{element.name}` is outside the photograph",
                box=list(element.box),
                photograph=f"{width} x {height} px",
                hint="give the `box` in pixels of this photograph: [left, top, right, bottom]",
            )
        mask = cut(photograph.rgb.pixels, element.box, options)
        if mask.any():
            found[element.name] = mask
    return _apart(found, boxed)


def cut(pixels: np.ndarray, box: Box, options: GrabcutOptions) -> np.ndarray:
    """The foreground mask (H, W) bool in a box.

    Args:
        pixels: (H, W, 3) uint8 sRGB.
        box: left, top, right, bottom [px], right and bottom excluded.
        options: The backend's.
    """
    import cv2

    cv2.setNumThreads(1)
    cv2.setRNGSeed(0)  # the colour models are initialised by k-means
    area, inner = _around(pixels.shape, box, options.surround)
    labels = np.full(pixels[area].shape[:2], cv2.GC_BGD, np.uint8)
    labels[inner] = cv2.GC_PR_FGD
    mask = np.zeros(pixels.shape[:2], bool)
    if (labels == cv2.GC_BGD).any():
        models = np.zeros((1, 65)), np.zeros((1, 65))
        crop = np.ascontiguousarray(pixels[area][..., ::-1])
        cv2.grabCut(crop, labels, None, *models, options.rounds, cv2.GC_INIT_WITH_MASK)
    mask[area] = _tidied((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD), options.smallest_part)
    return mask


def _around(shape: tuple[int, ...], box: Box, surround: float) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The crop of a box with its surroundings, and the box in this crop."""
    left, top, right, bottom = box
    x, y = max(8, round(surround * (right - left))), max(8, round(surround * (bottom - top)))
    rows = slice(max(0, top - y), min(shape[0], bottom + y))
    columns = slice(max(0, left - x), min(shape[1], right + x))
    inner = slice(top - rows.start, bottom - rows.start), slice(left - columns.start, right - columns.start)
    return (rows, columns), inner


def _tidied(mask: np.ndarray, smallest: float) -> np.ndarray:
    """The mask without specks and pinholes."""
    from scipy import ndimage

    opened = ndimage.binary_opening(mask, np.ones((3, 3), bool))
    labels, count = ndimage.label(opened)
    if not count:
        return opened
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    kept = np.isin(labels, np.flatnonzero(sizes >= max(1.0, smallest * sizes.max())))
    holes, _ = ndimage.label(~kept)
    small = np.bincount(holes.ravel()) < 0.01 * kept.sum()
    small[0] = False
    return np.asarray(kept | small[holes])


def _apart(found: dict[str, np.ndarray], boxed: list[Element]) -> dict[str, np.ndarray]:
    """Assign each shared pixel to the element with the smaller box."""
    sizes = {e.name: (e.box[2] - e.box[0]) * (e.box[3] - e.box[1]) for e in boxed if e.box is not None}
    taken: np.ndarray | None = None
    apart: dict[str, np.ndarray] = {}
    for name in sorted(found, key=lambda name: sizes[name]):
        mask = found[name] if taken is None else found[name] & ~taken
        taken = mask if taken is None else taken | mask
        apart[name] = mask
    return {name: apart[name] for name in found}
