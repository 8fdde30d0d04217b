"""Masks from geometry: surface patches above the support, with borders refined by colour."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.geometry.regions import box_of
from dextera_build.geometry.upright import turned
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace, turned_elements
from ..overlap import PART, Box, box_inside, box_iou
from ..regions import heights
from ..regions.proposals import scenery
from . import matte

BACKEND = Backend(
    summary="surface patches above the support, borders settled by colour",
    profiles=("cpu",),
    packages=("numpy", "scipy", "opencv-python-headless"),
    extra="twin",
)
SAME = 0.3


def masks(
    ctx: Context, photograph: Photograph, measured: Measurements[Workspace], elements: Elements, options: Options
) -> dict[str, np.ndarray]:
    """Interactive element -> mask (H, W) bool, in the elements' order."""
    workspace = measured.needed()
    level, turns = workspace.upright(), workspace.turns
    size = (workspace.camera.width, workspace.camera.height)
    wanted = turned_elements(elements.elements, size, turns)
    regions = elements.regions
    if regions is not None and regions.shape != workspace.depth.shape:
        ctx.fail(
            "the elements are of another picture",
            photograph=f"{size[0]} x {size[1]} px",
            elements=f"{regions.shape[1]} x {regions.shape[0]} px",
            hint="take both from one capture",
        )
    labels = scenery(level).labels if regions is None else turned(regions, turns)
    return {name: turned(mask, -turns) for name, mask in _masks(level, wanted, labels).items()}


def _masks(level: Workspace, elements: tuple[Element, ...], labels: np.ndarray) -> dict[str, np.ndarray]:
    """The masks of elements in an upright photograph, with regions `labels` (H, W)."""
    relief = heights.relief(level)
    raised: dict[str, np.ndarray] = {}
    for number in np.unique(labels[labels > 0]):
        mask = labels == number
        if owner := _owner(box_of(mask), elements):
            raised[owner] = raised[owner] | mask if owner in raised else mask
    everything = labels > 0
    finished: dict[str, np.ndarray] = {}
    taken = np.zeros_like(everything)
    for element in elements:
        if element.interactive and element.name in raised:
            own = raised[element.name]
            mask = matte.complete(own, (everything & ~own) | taken, relief, level.pixels)
            finished[element.name] = mask
            taken |= mask
    return finished


def _owner(region: Box, elements: tuple[Element, ...]) -> str | None:
    """The element with the best-fitting box; a fragment belongs to the element whose box contains it."""
    best, score = None, 0.0
    for element in elements:
        if element.box is None:
            continue
        iou = box_iou(region, element.box)
        inside = box_inside(region, element.box)
        if (iou >= SAME or inside >= PART) and iou > score:
            best, score = element.name, iou
    return best
