"""factorize.correct: replace masks by painted ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import Instance, InstanceMap, Segmentation
from dextera_build.errors import did_you_mean, listing
from dextera_build.rule import Context, Options, rule

from ..measured import of_workspace
from .cutting import Cutter, Said
from .marking import outlines
from .painted import painted
from .smeared import why_no_body


class CorrectOptions(Options):
    """Options of factorize.correct."""

    margin_px: NonNegativeInt = 24
    """Margin of the photograph around a mask in the cropped view [px]."""
    smallest_px: PositiveInt = 100
    """Minimum number of pixels of a painted mask [px]."""


@rule(version=1, packages=("pillow",))
def correct(
    ctx: Context,
    photograph: Photograph,
    objects: Segmentation,
    masks: Folder | None = None,
    measured: Measured | None = None,
    support: Support | None = None,
    *,
    options: CorrectOptions | None = None,
) -> Segmentation:
    """Return the segmentation with the masks of `masks` in place of those of the objects that they are named after.

    `masks` holds one `OBJECT.png` per corrected object, of the photograph's size: white is the object. An object
    without a file stays identical to the byte, unless a painted mask takes pixels from it, which is logged. A pixel
    shared by two painted masks belongs to the earlier object.
    """
    options = options or CorrectOptions()
    found = dict(_painted(ctx, masks, objects, photograph.rgb.pixels.shape[:2], options.smallest_px))
    before = objects.map.labels
    labels = _relabelled(objects, found)
    changed = [name for number, name in _numbered(objects) if ((before == number) != (labels == number)).any()]
    if not changed:
        ctx.say("masks unchanged" if not found else f"masks unchanged, {', '.join(found)} too")
        return objects
    lost = [name for number, name in _numbered(objects) if not (labels == number).any()]
    ctx.check(
        not lost,
        f"painted masks leave nothing of {listing(lost)}",
        painted=listing(found),
        hint="paint only the object itself; to leave an object out, set `interactive: false` in a `scene.yaml`",
    )
    workspace = of_workspace(ctx, photograph, measured, support)
    if any(one.view.asset_source == "rgbd" for one in objects.items.values()):
        workspace.needed()
    cutter = Cutter(photograph, measured, support, workspace)
    around = cutter.surroundings(labels, [objects.map.fixed])
    items = dict(objects.items)
    for number, name in _numbered(objects):
        # Without depth, occluders are inferred from the masks of the other objects, so all views are made again.
        if name in changed or not workspace.taken:
            one = objects.items[name]
            said = Said(one.view.phrase, one.traits, one.view.asset_source)
            items[name] = cutter.instance(number, around, said, options.margin_px)
    for name in changed:
        if doubt := why_no_body(items[name]):
            ctx.warn(f"`{name}.png`: nothing may come of this mask: {doubt}")
    ctx.say("; ".join(_lines(changed, found, objects.items, items)))
    ctx.preview(outlines(photograph.rgb.pixels, labels), "instances, as corrected")
    return objects.model_copy(update={"items": items, "map": InstanceMap(labels=labels, fixed=around.fixed)})


def _painted(
    ctx: Context, masks: Folder | None, objects: Segmentation, shape: tuple[int, int], smallest: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Object -> its painted mask (H, W) bool, in the objects' order."""
    files = {} if masks is None else {PurePosixPath(path): path for path in masks.files if not path.startswith(".")}
    other = [path for file, path in files.items() if file.suffix != ".png" or len(file.parts) > 1]
    if other:
        ctx.warn(f"not read: {listing(other)}; a mask is `OBJECT.png`, directly in the folder")
    named = {file.stem: path for file, path in files.items() if path not in other}
    for stem, path in named.items():
        ctx.check(
            stem in objects.names,
            f"`{path}` is the mask of no object",
            objects=listing(objects.names),
            hint=did_you_mean(stem, objects.names) or f"rename it, or remove it; `{objects.names[0]}.png` is a name",
        )
    for name in objects.names:
        if masks is not None and name in named:
            yield name, painted(ctx, masks.files[named[name]], named[name], shape, smallest)


def _relabelled(objects: Segmentation, found: Mapping[str, np.ndarray]) -> np.ndarray:
    """The map (H, W) int32 of the objects with painted masks (H, W) bool; the earlier object keeps shared pixels."""
    labels = objects.map.labels.copy()
    numbers = {name: number for number, name in _numbered(objects) if name in found}
    labels[np.isin(labels, list(numbers.values()))] = 0
    for name, number in reversed(numbers.items()):
        labels[found[name]] = number
    return labels


def _numbered(objects: Segmentation) -> Iterator[tuple[int, str]]:
    """Label and name of every object."""
    yield from enumerate(objects.names, start=1)


def _lines(
    changed: list[str], found: Mapping[str, np.ndarray], before: Mapping[str, Instance], after: Mapping[str, Instance]
) -> Iterator[str]:
    for name in changed:
        old, new = (int(one[name].view.mask.sum()) for one in (before, after))
        yield f"{name} {old:,} -> {new:,} px" + ("" if name in found else ", taken by a painted mask")
