"""factorize.parse: the elements of the photograph, by name."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.base import File
from dextera_build.artifacts.camera import Capture
from dextera_build.artifacts.object import Element, Elements, Support
from dextera_build.errors import listing
from dextera_build.rule import Context, Fraction, Options, rule

from ..masks.marking import boxes
from ..regions.heights import relief
from . import scene_file


class ParseOptions(Options):
    """Options of factorize.parse."""

    match_iou: Fraction = 0.3
    """Smallest overlap (IoU) at which a box of `scene.yaml` matches a proposal."""


class ParseBackend(Protocol):
    """What a backend of factorize.parse defines."""

    def propose(self, ctx: Context, capture: Capture, support: Support, options: Any) -> tuple[Element, ...]:
        """Every object above the support with its box [px]."""
        ...


@rule(version=1)
def parse(
    ctx: Context[ParseBackend], capture: Capture, support: Support, scene: File | None = None, *, options: ParseOptions
) -> Elements:
    """Return the elements of the photograph: proposals above the support, or the entries of a `scene.yaml`.

    The backend offers `propose(ctx, capture, support, model) -> tuple[Element, ...]`: everything above
    the support, each with its box [px]; `interactive` distinguishes handled objects from the static scene.
    """
    proposals: tuple[Element, ...] = ctx.backend.propose(ctx, capture, support, ctx.backend_options)
    table = Element(name="support", category="support", phrase="support", interactive=False, material="wood")
    if scene is None:
        found, source = proposals, "proposed"
    else:
        wanted = scene_file.read(scene.data)
        found, source = scene_file.match(wanted, proposals, options.match_iou), "scene.yaml"
    interactive = [element.name for element in found if element.interactive]
    if not interactive:
        _nothing(ctx, capture, support, found)
    result = Elements(elements=(*found, *([] if any(e.name == "support" for e in found) else [table])), source=source)
    static = sum(not element.interactive for element in found)
    ctx.say(f"{', '.join(interactive)}" + (f"; {static} static" if static else ""))
    ctx.preview(boxes(capture.rgb.pixels, found), "elements")
    return result


def _nothing(ctx: Context, capture: Capture, support: Support, found: tuple[Element, ...]) -> None:
    heights = relief(capture, support)
    depth = capture.depth.depth > 0
    ctx.fail(
        "no object stands on the support",
        points_above=f"{int((heights.raised & heights.over).sum()):,} px over the support",
        threshold=f"{1000 * float(np.median(heights.threshold[heights.valid])):.1f} mm at the median depth",
        static=listing(element.name for element in found),
        depth=f"{depth.mean():.0%} of the pixels, median {float(np.median(capture.depth.depth[depth])):.2f} m",
        hint="look at the preview of `support` and at the depth's unit; things that the image border cuts are static",
    )
