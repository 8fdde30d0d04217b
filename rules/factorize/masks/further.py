"""factorize.further: the objects in further photographs of the scene."""

from __future__ import annotations

import numpy as np
from pydantic import NonNegativeInt

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import FurtherView, FurtherViews, Instance, Segmentation
from dextera_build.rule import Context, Options, rule

from ..measured import of_workspace
from ..overlap import crop
from ..regions.heights import relief
from .again import FEWEST, objects_in
from .cutting import Cutter, Said, Surroundings
from .marking import outlines


class FurtherOptions(Options):
    """Options of factorize.further."""

    margin_px: NonNegativeInt = 24
    """Margin of a photograph around a mask in the cropped view [px]."""


@rule(version=1, packages=("numpy", "scipy"))
def further(
    ctx: Context,
    photograph: Photograph,
    objects: Segmentation,
    support: Support,
    photographs: FurtherPhotographs | None = None,
    *,
    options: FurtherOptions | None = None,
) -> Segmentation:
    """Return the segmentation with the views of each object in the further photographs; masks stay as they are.

    An object is found by its surface, see `again`; what only a further photograph shows is no object.

    Args:
        ctx: Context.
        photograph: The first photograph.
        objects: Its objects.
        support: Its support.
        photographs: Further photographs with their poses; None: none.
        options: Options.
    """
    options = options or FurtherOptions()
    if photographs is None or not photographs.items:
        ctx.say("one photograph")
        return objects
    if any(one.measured is None for one in objects.items.values()):
        ctx.fail(
            "the first photograph has no depth, so its objects cannot be found in further ones",
            hint="add its depth, or remove `photographs` from `capture.json`",
        )
    views: dict[str, list[FurtherView]] = {name: [] for name in objects.items}
    shown = []
    for one in photographs.items:
        found = _views(ctx, one, objects, support, options.margin_px)
        for name, view in found.items():
            views[name].append(view)
        shown.append(f"{one.file} shows {len(found)} of {len(views)}")
    ctx.say("; ".join(shown))
    items = {
        name: one.model_copy(update={"further": FurtherViews(items=tuple(views[name])) if views[name] else None})
        for name, one in objects.items.items()
    }
    return objects.model_copy(update={"items": items})


def _views(ctx: Context, one: Further, objects: Segmentation, support: Support, margin: int) -> dict[str, FurtherView]:
    """Object -> its view in a photograph."""
    if one.pose is None or one.capture.measured is None:
        ctx.fail(f"`{one.file}` has no pose", hint="pass the photographs through `align.photographs`")
    pose = support.camera_pose.matrix @ one.pose.matrix
    there = support.model_copy(update={"camera_pose": support.camera_pose.model_copy(update={"matrix": pose})})
    picture = one.capture.photograph
    workspace = of_workspace(ctx, picture, one.capture.measured, there)
    seen = workspace.needed()
    heights = relief(seen)
    found = objects_in(seen, heights, objects.items)
    around = Surroundings(found.labels, found.unknown, heights.raised, seen.depth)
    cutter = Cutter(picture, one.capture.measured, there, workspace)
    views = {}
    for number, (name, known) in enumerate(objects.items.items(), start=1):
        if (found.labels == number).any():
            said = Said(known.view.phrase, known.traits, known.view.asset_source)
            views[name] = _view(one.file, cutter.instance(number, around, said, margin), around, number, margin)
    if found.strange > FEWEST:
        ctx.warn(
            f"{one.file} shows something on the support that the first photograph does not, {found.strange:,} px: it "
            "is no part of the twin; make the photograph that shows all objects the first one"
        )
    ctx.preview(outlines(picture.rgb.pixels, found.labels), f"objects in {one.file}")
    return views


def _view(name: str, cut: Instance, around: Surroundings, number: int, margin: int) -> FurtherView:
    """The view, with the pixels that may be the object's among those that are hidden."""
    assert cut.measured is not None
    box = crop(around.labels == number, margin)
    hidden = np.ascontiguousarray(cut.view.occluder | (around.fixed[box] & ~cut.view.mask))
    return FurtherView(file=name, view=cut.view.model_copy(update={"occluder": hidden}), measured=cut.measured)
