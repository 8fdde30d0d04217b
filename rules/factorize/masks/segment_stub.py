"""Unrefined masks: connected pixels above the support."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Elements
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace
from ..overlap import box_iou
from ..regions.blobs import blobs

BACKEND = Backend(summary="connected pixels above the support", profiles=("stub",))


def masks(
    ctx: Context, photograph: Photograph, measured: Measurements[Workspace], elements: Elements, options: Options
) -> dict[str, np.ndarray]:
    """Interactive element -> mask (H, W) bool of the region with the largest box overlap."""
    found = {}
    seen = blobs(measured.needed())
    for element in elements.elements:
        if element.interactive and element.box is not None and seen:
            best = max(seen, key=lambda blob: box_iou(blob.box, element.box or blob.box))
            if box_iou(best.box, element.box) > 0:
                found[element.name] = best.mask
    return found
