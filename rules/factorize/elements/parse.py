"""factorize.parse: the elements of the photograph, by name."""

from __future__ import annotations

from typing import Any, NoReturn, Protocol

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.cameras.image import LabelImage
from dextera_build.artifacts.objects.object import Element, Elements, Support
from dextera_build.errors import listing
from dextera_build.rule import Context, Fraction, Options, rule

from ..masks.marking import boxes
from ..measured import Measurements, Workspace, of_workspace, robot_pixels
from ..regions.divide import divided
from ..regions.heights import relief
from . import borders, matching, points, scene_file
from .nothing import causes


class ParseOptions(Options):
    """Options of factorize.parse."""

    match_iou: Fraction = 0.3
    """Smallest IoU at which a box of `scene.yaml` matches a proposal."""


class ParseBackend(Protocol):
    """Interface of a backend of factorize.parse."""

    def propose(
        self, ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: Any
    ) -> Elements | None:
        """Every object on the support with its box [px]; None if the backend leaves that to `scene.yaml`."""
        ...


@rule(version=6)
def parse(
    ctx: Context[ParseBackend],
    photograph: Photograph,
    measured: Measured | None = None,
    support: Support | None = None,
    scene: File | None = None,
    robot: LabelImage | None = None,
    *,
    options: ParseOptions | None = None,
) -> Elements:
    """Return the elements of the photograph: proposals on the support, or the entries of a `scene.yaml`.

    `interactive` distinguishes movable objects from the static scene. Backends that read depth and support have their
    result labelled `rgbd`, and exclude the pixels of the robot, where `robot` is not 0.
    """
    options = options or ParseOptions()
    depth = of_workspace(ctx, photograph, measured, support, robot_pixels(ctx, photograph, robot))
    proposals = ctx.backend.propose(ctx, photograph, depth, ctx.backend_options)
    table = Element(name="support", category="support", phrase="support", interactive=False, material="wood")
    if scene is not None:
        wanted, source = scene_file.read(scene.data), "scene.yaml"
        scene_file.inside(wanted, *photograph.rgb.pixels.shape[1::-1])
        if proposals is None:
            found = matching.boxed(wanted)
        else:
            proposals = points.settled(wanted, proposals, lambda region, own: divided(depth.needed(), region, own))
            found = matching.match(wanted, proposals.elements, options.match_iou, points.finder(proposals.regions))
    elif proposals is None:
        ctx.fail("this backend proposes no elements, and no `scene.yaml` lists them", hint="give the input `scene`")
    else:
        found, source = proposals.elements, "proposed"
    interactive = [element.name for element in found if element.interactive]
    if not interactive:
        _nothing(ctx, depth, found)
    everything = (*found, *([] if any(e.name == "support" for e in found) else [table]))
    regions = None if proposals is None else proposals.regions
    result = Elements(elements=everything, source=source, asset_source=depth.source(), regions=regions)
    for doubt in borders.doubts(found, photograph.rgb.pixels.shape[1::-1]):
        ctx.warn(doubt)
    static = sum(not element.interactive for element in found)
    ctx.say(f"{', '.join(interactive)}" + (f"; {static} static" if static else ""))
    ctx.preview(boxes(photograph.rgb.pixels, found), "elements")
    return result


def _nothing(ctx: Context, measured: Measurements[Workspace], found: tuple[Element, ...]) -> NoReturn:
    static = listing(element.name for element in found)
    if not measured.taken:
        ctx.fail("no object was found in the photograph", static=static, hint="list the objects in a `scene.yaml`")
    seen = measured.needed()
    heights = relief(seen)
    depth = seen.depth > 0
    (cause, todo), *more = causes(seen, tuple(element for element in found if not element.interactive))
    ctx.fail(
        f"no object stands on the support: {cause}",
        **({"besides": more[0][0]} if len(more) > 1 else {}),
        points_above=f"{int((heights.raised & heights.over).sum()):,} px over the support",
        threshold=f"{1000 * float(np.median(heights.threshold[heights.valid])):.1f} mm at the median depth",
        static=static,
        depth=f"{depth.mean():.0%} of the pixels, median {float(np.median(seen.depth[depth])):.2f} m",
        hint=todo,
    )
