"""factorize.segment: a mask per object, and a view of each cropped from the photograph."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.object import Element, Elements, Support
from dextera_build.artifacts.objects.view import Segmentation, Traits
from dextera_build.errors import listing
from dextera_build.geometry.regions import box_of
from dextera_build.rule import Context, Fraction, Options, rule

from ..measured import Measurements, Workspace, of_workspace, robot_pixels
from ..overlap import suppress
from ..regions.borders import sides
from .beside_depth import things_beside_depth
from .clear import Clear, clear_things
from .cutting import Cutter, Said
from .marking import outlines
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
    """Interface of a backend of factorize.segment."""

    def masks(
        self, ctx: Context, photograph: Photograph, measured: Measurements[Workspace], elements: Elements, options: Any
    ) -> dict[str, np.ndarray]:
        """Element -> mask (H, W) bool, most trusted first; of static elements only without depth."""
        ...


@rule(version=8)
def segment(
    ctx: Context[SegmentBackend],
    photograph: Photograph,
    elements: Elements,
    measured: Measured | None = None,
    support: Support | None = None,
    robot: LabelImage | None = None,
    *,
    options: SegmentOptions | None = None,
) -> Segmentation:
    """Return the mask and the view of every interactive element, with the depth in its crop if available.

    Depth is in the world frame of `support`. Occluders are found from the depth if the backend reads it, else from the
    picture: of two objects on one support, the one whose lowest pixel is lower is nearer. Pixels of the robot, where
    `robot` is not 0, are excluded from all masks, but the robot may occlude objects.
    """
    options = options or SegmentOptions()
    wanted = {element.name: element for element in elements.elements if element.interactive}
    machine = robot_pixels(ctx, photograph, robot)
    depth = of_workspace(ctx, photograph, measured, support, machine)
    masks = ctx.backend.masks(ctx, photograph, depth, elements, ctx.backend_options)
    if machine is not None:
        masks = {name: mask & ~machine for name, mask in masks.items()}
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
    clear = clear_things(depth.needed(), found) if depth.taken else []
    scraps = {name for thing in clear for name in thing.scraps}
    found = {name: mask for name, mask in found.items() if name not in scraps}
    ctx.check(bool(found), "nothing but clear or shiny things was found", hint=MATT)
    source = depth.source(elements.asset_source)
    said = {name: Said(element.phrase, _traits(element), source) for name, element in wanted.items()}
    static = [mask for name, mask in masks.items() if name not in wanted]
    static += [] if machine is None else [machine]
    cutter = Cutter(photograph, measured, support, depth)
    result = _cut_out(cutter, found, said, static, options.margin_px)
    bad: dict[str, str] = {}
    if depth.taken:
        bad = _no_bodies(ctx, result)
        found = {name: mask for name, mask in found.items() if name not in bad}
        result = _cut_out(cutter, found, said, static, options.margin_px) if bad else result
        _warn(ctx, result)
    _tell_cut(ctx, result)
    lost = sorted(set(wanted) - set(result.names) - set(bad) - scraps)
    ctx.say(f"{', '.join(result.names)}" + (f"; nothing of {', '.join(lost)}" if lost else ""))
    ctx.preview(outlines(photograph.rgb.pixels, result.map.labels), "instances")
    _tell_clear(ctx, photograph.rgb.pixels, clear)
    for box in things_beside_depth(depth.needed()) if depth.taken else []:
        ctx.warn(
            f"a thing is in the box {list(box)}, beside the depth image, which is narrower than the photograph: it "
            "is no body; turn the camera so that it is nearer to the middle"
        )
    return result


MATT = "cover clear and shiny things with a matt spray or tape"


def _no_bodies(ctx: Context, result: Segmentation) -> dict[str, str]:
    """Objects that cannot be reconstructed, and why, with a warning for each."""
    bad = {name: why for name, one in result.items.items() if (why := why_no_body(one))}
    for name, why in bad.items():
        ctx.warn(f"{name} stays in the background: {why}")
    ctx.check(
        len(bad) < len(result.items),
        "no segmented object yields a valid body",
        objects=listing(f"{name}: {why}" for name, why in bad.items()),
        hint="capture it from nearer, in better light, or name it in a `scene.yaml` and choose a backend of "
        "`factorize.mesh` that needs no depth: `dxb ls backends`",
    )
    return bad


def _tell_cut(ctx: Context, result: Segmentation) -> None:
    """A warning for each object that the border cuts."""
    size = result.map.labels.shape[::-1]
    for name in (name for name, one in result.items.items() if one.traits.cut):
        where = f"the {listing(sides(box_of(result.mask(name)), size))} border of the picture cuts"
        ctx.warn(f"{where} {name}: what is outside the picture is completed by symmetry")


def _tell_clear(ctx: Context, pixels: np.ndarray, things: list[Clear]) -> None:
    """A warning for each clear or shiny thing, and a picture of them."""
    labels = np.zeros(pixels.shape[:2], np.int32)
    for number, thing in enumerate(things, start=1):
        labels[thing.mask] = number
        scraps = f"; {listing(thing.scraps)}, which is a part of it, is no body" if thing.scraps else ""
        ctx.warn(
            f"a clear or shiny thing is in the box {list(thing.box)}: {thing.without:.0%} of it has no depth, or that "
            f"of what is behind it: it stays in the background{scraps}; {MATT}"
        )
    if things:
        ctx.preview(outlines(pixels, labels), "clear or shiny things, which are no bodies")


def _warn(ctx: Context, result: Segmentation) -> None:
    """Warn about doubtful measurements."""
    for name, one in result.items.items():
        if doubt := sparse(one):
            ctx.warn(f"{name}: {doubt}")
    if odd := odd_scale({name: size(one) for name, one in result.items.items()}):
        ctx.warn(f"{odd}: check `depth_scale_m` and the focal length of the capture")


def _cut_out(
    cutter: Cutter, found: dict[str, np.ndarray], said: dict[str, Said], static: list[np.ndarray], margin: int
) -> Segmentation:
    """The objects with a mask, in the order of the elements."""
    named = {name: one for name, one in said.items() if name in found}
    return cutter.cut_out(_labels([found[name] for name in named]), named, static, margin)


def _traits(element: Element) -> Traits:
    return Traits(**{name: getattr(element, name) for name in Traits.model_fields})


def _labels(masks: list[np.ndarray]) -> np.ndarray:
    """(H, W) int32, 1 for the first of the masks (H, W) bool; a shared pixel belongs to the earlier one."""
    labels = np.zeros(masks[0].shape, np.int32)
    for number in range(len(masks), 0, -1):
        labels[masks[number - 1]] = number
    return labels
