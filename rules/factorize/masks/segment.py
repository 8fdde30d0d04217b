"""factorize.segment: a mask per object, and a view of each cropped from the capture."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.camera import Capture
from dextera_build.artifacts.image import DepthImage, Image, LabelImage
from dextera_build.artifacts.object import Element, Elements, ObjectView, Segmentation, Support
from dextera_build.errors import listing
from dextera_build.rule import Context, Fraction, Options, rule

from ..regions.heights import relief
from .marking import outlines
from .occlusion import occluders
from .overlap import suppress


class SegmentOptions(Options):
    """Options of factorize.segment."""

    margin_px: NonNegativeInt = 24
    """Margin of the photograph around a mask in the cropped view [px]."""
    duplicate_iou: Fraction = 0.8
    """Masks with a larger IoU are one object."""
    duplicate_inside: Fraction = 0.95
    """Masks are one object if a larger fraction of one is inside the other."""
    smallest_px: PositiveInt = 100
    """Masks with fewer pixels are discarded [px]."""


class SegmentBackend(Protocol):
    """What a backend of factorize.segment defines."""

    def masks(
        self, ctx: Context, capture: Capture, support: Support, elements: Elements, options: Any
    ) -> dict[str, np.ndarray]:
        """Interactive element -> mask (H, W) bool."""
        ...


@rule(version=1)
def segment(
    ctx: Context[SegmentBackend], capture: Capture, support: Support, elements: Elements, *, options: SegmentOptions
) -> Segmentation:
    """Return the mask and the view of every interactive element; views are in the world frame of `support`.

    The backend offers `masks(capture, support, elements) -> dict[str, (H, W) bool]` for the interactive elements,
    most trusted first.
    """
    wanted = {element.name: element for element in elements.elements if element.interactive}
    found = suppress(
        ctx.backend.masks(ctx, capture, support, elements, ctx.backend_options),
        options.duplicate_iou,
        options.duplicate_inside,
    )
    found = {name: mask for name, mask in found.items() if mask.sum() >= options.smallest_px}
    ctx.check(
        bool(found),
        "no element could be segmented",
        elements=listing(wanted),
        hint="check the boxes of the elements against the photograph",
    )
    names = tuple(name for name in wanted if name in found)
    labels = np.zeros(capture.depth.depth.shape, np.int32)
    for number in range(len(names), 0, -1):
        labels[found[names[number - 1]]] = number
    raised = relief(capture, support).raised
    views = {
        name: _view(capture, support, labels == number, raised, wanted[name], options)
        for number, name in enumerate(names, start=1)
    }
    lost = sorted(set(wanted) - set(names))
    ctx.say(f"{', '.join(names)}" + (f"; nothing of {', '.join(lost)}" if lost else ""))
    ctx.preview(outlines(capture.rgb.pixels, labels), "instances")
    return Segmentation(items=views, names=names, labels=LabelImage(labels=labels), fixed=raised & (labels == 0))


def _view(
    capture: Capture, support: Support, mask: np.ndarray, raised: np.ndarray, element: Element, options: SegmentOptions
) -> ObjectView:
    rows, columns = np.nonzero(mask)
    top, bottom = max(0, int(rows.min()) - options.margin_px), int(rows.max()) + options.margin_px + 1
    left, right = max(0, int(columns.min()) - options.margin_px), int(columns.max()) + options.margin_px + 1
    box = (slice(top, min(bottom, mask.shape[0])), slice(left, min(right, mask.shape[1])))
    crop = np.ascontiguousarray(mask[box])
    return ObjectView(
        rgb=Image(pixels=np.ascontiguousarray(capture.rgb.pixels[box])),
        depth=DepthImage(depth=np.ascontiguousarray(capture.depth.depth[box])),
        mask=crop,
        occluder=occluders(crop, raised[box], capture.depth.depth[box].astype(np.float64)),
        camera=capture.camera.crop(left, top, crop.shape[1], crop.shape[0]),
        camera_pose=support.camera_pose,
        category=element.category,
        body_type=element.body_type,
        material=element.material,
    )
