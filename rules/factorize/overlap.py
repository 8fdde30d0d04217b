"""Overlap of boxes and masks, and duplicate suppression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dextera_build.geometry.regions import box_of

Box = tuple[int, int, int, int]
PART = 0.85
"""Fraction of a box inside another one above which it is a part of the same object."""


def box_iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes (left, top, right, bottom), right and bottom excluded."""
    shared = _shared(a, b)
    return shared / max(1, box_area(a) + box_area(b) - shared)


def box_inside(a: Box, b: Box) -> float:
    """Fraction of box `a` inside box `b`."""
    return _shared(a, b) / max(1, box_area(a))


def around(boxes: Sequence[Box]) -> Box:
    """The smallest box around several boxes."""
    left, top, right, bottom = zip(*boxes, strict=True)
    return min(left), min(top), max(right), max(bottom)


def inwards(mask: np.ndarray) -> np.ndarray:
    """Distance (H, W) of each pixel of a mask (H, W) bool to its outside, where the picture ends as well [px]."""
    from scipy import ndimage

    return np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1])


def crop(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    """Rows and columns of a picture that contain a mask (H, W) bool with a margin [px]."""
    left, top, right, bottom = box_of(mask)
    height, width = mask.shape
    return (
        slice(max(0, top - margin), min(bottom + margin, height)),
        slice(max(0, left - margin), min(right + margin, width)),
    )


def suppress(masks: Mapping[str, np.ndarray], most_iou: float, most_inside: float) -> dict[str, np.ndarray]:
    """Drop each mask that duplicates an earlier one.

    Args:
        masks: Name -> (H, W) bool, most trusted first.
        most_iou: Masks with a larger IoU are duplicates.
        most_inside: Masks are duplicates if a larger fraction of the smaller one is inside the other.
    """
    kept: dict[str, np.ndarray] = {}
    for name, mask in masks.items():
        area = int(mask.sum())
        repeats = False
        for other in kept.values():
            shared = int((mask & other).sum())
            iou = shared / max(1, area + int(other.sum()) - shared)
            repeats |= iou > most_iou or shared > most_inside * max(1, min(area, int(other.sum())))
        if area and not repeats:
            kept[name] = mask
    return kept


def box_area(box: Box) -> int:
    """Pixels in a box."""
    return max(0, box[2] - box[0]) * max(0, box[3] - box[1])


def _shared(a: Box, b: Box) -> int:
    return box_area((max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])))
