"""Masks from geometry: surface patches above the support, with borders refined by colour."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.camera import Photograph
from dextera_build.artifacts.object import Element, Elements
from dextera_build.geometry.upright import turned
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace, turned_elements
from ..overlap import PART, box_inside, box_iou
from ..regions.proposals import Proposal, scenery
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
    return {name: turned(mask, -turns) for name, mask in _masks(level, wanted).items()}


def _masks(level: Workspace, elements: tuple[Element, ...]) -> dict[str, np.ndarray]:
    """The masks of elements in an upright photograph."""
    seen = scenery(level)
    owners = [_owner(proposal, elements) for proposal in seen.objects]
    raised: dict[str, np.ndarray] = {}
    for element in elements:
        parts = [p.mask for p, owner in zip(seen.objects, owners, strict=True) if owner == element.name]
        if parts:
            raised[element.name] = np.logical_or.reduce(parts)
    everything = np.logical_or.reduce([proposal.mask for proposal in seen.objects] or [np.zeros_like(seen.other)])
    finished: dict[str, np.ndarray] = {}
    taken = np.zeros_like(everything)
    for element in elements:
        if element.interactive and element.name in raised:
            own = raised[element.name]
            mask = matte.complete(own, (everything & ~own) | taken, seen.relief, level.pixels)
            finished[element.name] = mask
            taken |= mask
    return finished


def _owner(proposal: Proposal, elements: tuple[Element, ...]) -> str | None:
    """The element with the best-fitting box; a fragment belongs to the element whose box contains it."""
    best, score = None, 0.0
    for element in elements:
        if element.box is None:
            continue
        iou = box_iou(proposal.box, element.box)
        inside = box_inside(proposal.box, element.box)
        if (iou >= SAME or inside >= PART) and iou > score:
            best, score = element.name, iou
    return best
