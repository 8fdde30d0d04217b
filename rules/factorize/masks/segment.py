"""factorize.segment: a mask per object, and a view of each cropped from the photograph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.camera import Measured, Photograph
from dextera_build.artifacts.image import DepthImage, Image
from dextera_build.artifacts.object import AssetSource, Element, Elements, Support
from dextera_build.artifacts.view import Instance, InstanceMap, MeasuredView, ObjectView, Segmentation, Traits
from dextera_build.errors import listing
from dextera_build.geometry import upright
from dextera_build.rule import Context, Fraction, Options, rule

from ..measured import Measurements, Workspace, of_workspace
from ..regions.heights import relief
from .marking import outlines
from .occlusion import lower_in_the_picture, occluders
from .overlap import suppress
from .smeared import odd_scale, size, sparse, why_no_body


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
        self, ctx: Context, photograph: Photograph, measured: Measurements[Workspace], elements: Elements, options: Any
    ) -> dict[str, np.ndarray]:
        """Element -> mask (H, W) bool, most trusted first; of static elements only without depth."""
        ...


@rule(version=5)
def segment(
    ctx: Context[SegmentBackend],
    photograph: Photograph,
    elements: Elements,
    measured: Measured | None = None,
    support: Support | None = None,
    *,
    options: SegmentOptions | None = None,
) -> Segmentation:
    """Return the mask and the view of every interactive element, and the depth in its crop if there is some.

    Depth is in the world frame of `support`. What hides an object comes from the depth if the backend reads it, else
    from the picture: of two things on one support, the one whose lowest pixel is lower is nearer.
    """
    options = options or SegmentOptions()
    wanted = {element.name: element for element in elements.elements if element.interactive}
    depth = of_workspace(ctx, photograph, measured, support)
    masks = ctx.backend.masks(ctx, photograph, depth, elements, ctx.backend_options)
    found = suppress(
        {name: mask for name, mask in masks.items() if name in wanted}, options.duplicate_iou, options.duplicate_inside
    )
    found = {name: mask for name, mask in found.items() if mask.sum() >= options.smallest_px}
    ctx.check(
        bool(found),
        "no element could be segmented",
        elements=listing(wanted),
        hint="check the boxes of the elements against the photograph",
    )
    picture = _Picture(photograph, measured, support, depth, masks, wanted, depth.source(elements.asset_source))
    result = picture.cut_out(found, options.margin_px)
    bad: dict[str, str] = {}
    if depth.taken:
        bad = {name: why for name, one in result.items.items() if (why := why_no_body(one))}
        for name, why in bad.items():
            ctx.warn(f"{name} stays in the background: {why}")
        found = {name: mask for name, mask in found.items() if name not in bad}
        ctx.check(
            bool(found),
            "nothing that was found can become a body",
            objects=listing(f"{name}: {why}" for name, why in bad.items()),
            hint="capture it from nearer, in better light, or name it in a `scene.yaml` and choose a backend of "
            "`factorize.mesh` that needs no depth: `dxb ls backends`",
        )
        result = picture.cut_out(found, options.margin_px) if bad else result
        for name, one in result.items.items():
            if doubt := sparse(one):
                ctx.warn(f"{name}: {doubt}")
        odd = odd_scale({name: size(one) for name, one in result.items.items()})
        if odd:
            ctx.warn(f"{odd}: check `depth_scale_m` and the focal length of the capture")
    lost = sorted(set(wanted) - set(result.names) - set(bad))
    ctx.say(f"{', '.join(result.names)}" + (f"; nothing of {', '.join(lost)}" if lost else ""))
    ctx.preview(outlines(photograph.rgb.pixels, result.map.labels), "instances")
    return result


@dataclass(frozen=True)
class _Picture:
    """A photograph with the masks of its elements."""

    photograph: Photograph
    measured: Measured | None
    support: Support | None
    depth: Measurements[Workspace]
    masks: Mapping[str, np.ndarray]
    wanted: Mapping[str, Element]
    source: AssetSource

    def cut_out(self, found: Mapping[str, np.ndarray], margin: int) -> Segmentation:
        """The instances of these masks; of two that share a pixel, the earlier element has it."""
        names = tuple(name for name in self.wanted if name in found)
        labels = np.zeros(self.photograph.rgb.pixels.shape[:2], np.int32)
        for number in range(len(names), 0, -1):
            labels[found[names[number - 1]]] = number
        others = [mask for name, mask in self.masks.items() if name not in self.wanted]
        turns = 0 if self.support is None else upright.turns(self.support.camera_pose.matrix)
        around = _surroundings(self.depth, labels, others, turns)
        items = {
            name: self._instance(labels, number, name, around, margin) for number, name in enumerate(names, start=1)
        }
        return Segmentation(items=items, names=names, map=InstanceMap(labels=labels, fixed=around.fixed))

    def _instance(self, labels: np.ndarray, number: int, name: str, around: _Surroundings, margin: int) -> Instance:
        box = _box(labels == number, margin)
        mask, element = np.ascontiguousarray(labels[box] == number), self.wanted[name]
        view = ObjectView(
            rgb=Image(pixels=np.ascontiguousarray(self.photograph.rgb.pixels[box])),
            mask=mask,
            occluder=around.hiding(number, box),
            camera=self.photograph.camera.crop(box[1].start, box[0].start, mask.shape[1], mask.shape[0]),
            phrase=element.phrase,
            asset_source=self.source,
        )
        traits = Traits(**{name: getattr(element, name) for name in Traits.model_fields})
        return Instance(view=view, traits=traits, measured=_measured(self.measured, self.support, box))


Box = tuple[slice, slice]


@dataclass(frozen=True)
class _Surroundings:
    """What else is in the picture, from depth or from the masks alone."""

    labels: np.ndarray
    """(H, W) int32 instance labels."""
    fixed: np.ndarray
    """(H, W) bool, things that are no object."""
    raised: np.ndarray | None = None
    """(H, W) bool, measured pixels above the support; None without depth."""
    depth: np.ndarray | None = None
    """(H, W) float32 [m]; None without depth."""
    turns: int = 0
    """Counter-clockwise quarter turns that make the photograph upright."""

    def hiding(self, number: int, box: Box) -> np.ndarray:
        """Pixels of a crop where something nearer may hide object `number`, (h, w) bool."""
        if self.raised is None or self.depth is None:
            labels, fixed = (upright.turned(picture, self.turns) for picture in (self.labels, self.fixed))
            lower = upright.turned(lower_in_the_picture(labels, fixed, number), -self.turns)
            return np.ascontiguousarray(lower[box])
        mask = np.ascontiguousarray(self.labels[box] == number)
        return occluders(mask, self.raised[box], self.depth[box].astype(np.float64))


def _surroundings(
    depth: Measurements[Workspace], labels: np.ndarray, static: list[np.ndarray], turns: int
) -> _Surroundings:
    if depth.taken:
        seen = depth.needed()
        raised = relief(seen).raised
        return _Surroundings(labels, raised & (labels == 0), raised, seen.depth)
    fixed = np.logical_or.reduce([np.zeros(labels.shape, bool), *static]) & (labels == 0)
    return _Surroundings(labels, fixed, turns=turns)


def _box(mask: np.ndarray, margin: int) -> Box:
    rows, columns = np.nonzero(mask)
    top, bottom = max(0, int(rows.min()) - margin), int(rows.max()) + margin + 1
    left, right = max(0, int(columns.min()) - margin), int(columns.max()) + margin + 1
    return slice(top, min(bottom, mask.shape[0])), slice(left, min(right, mask.shape[1]))


def _measured(measured: Measured | None, support: Support | None, box: Box) -> MeasuredView | None:
    if measured is None or support is None:
        return None
    depth = DepthImage(depth=np.ascontiguousarray(measured.depth.depth[box]))
    return MeasuredView(depth=depth, camera_pose=support.camera_pose)
