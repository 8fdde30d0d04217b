"""Connected pixels above the support, for the stub backends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import regions
from dextera_build.geometry.regions import box_of

from ..measured import Workspace
from .heights import relief

FEWEST = 150
RISE_M = 0.015


@dataclass(frozen=True)
class Blob:
    """One connected region."""

    mask: np.ndarray
    """(H, W) bool."""
    box: tuple[int, int, int, int]
    """left, top, right, bottom [px], right and bottom excluded."""
    cut: bool
    """Whether the region touches the image border."""


def blobs(seen: Workspace) -> list[Blob]:
    """Regions of at least 150 pixels more than 15 mm above the support's outline, in scan order."""
    heights = relief(seen)
    labels, count = regions.label(heights.raised & heights.over & (heights.height > RISE_M))
    found = []
    for number in range(1, count + 1):
        mask = labels == number
        if mask.sum() < FEWEST:
            continue
        box = box_of(mask)
        cut = box[0] == 0 or box[1] == 0 or box[2] == mask.shape[1] or box[3] == mask.shape[0]
        found.append(Blob(mask, box, cut))
    return found
