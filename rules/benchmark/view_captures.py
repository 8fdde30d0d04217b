"""benchmark.view_captures: the views of a folder as captures, without their poses."""

from __future__ import annotations

from pydantic import NonNegativeInt

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.camera import Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from ..evaluate.posed import PosedViews


class ViewCapturesOptions(Options):
    """Options of benchmark.view_captures."""

    frames: tuple[NonNegativeInt, ...] = ()
    """Frames of the views; empty: all."""


@rule(version=1, packages=("numpy", "pillow"))
def view_captures(ctx: Context, views: Folder, *, options: ViewCapturesOptions | None = None) -> Collection[Capture]:
    """Return photograph and depth [m] of each view of `views.json`, by its frame, without the poses."""
    given = PosedViews(ctx, views)
    chosen = (options.frames if options else ()) or tuple(sorted(given.poses))
    if unknown := [str(frame) for frame in chosen if frame not in given.poses]:
        ctx.fail(f"there is no view `{unknown[0]}`", views=listing([str(frame) for frame in given.poses]))
    found = {}
    for frame in chosen:
        view = given.view(frame)
        found[f"view_{frame}"] = Capture(
            photograph=Photograph(rgb=Image(pixels=view.rgb), camera=given.camera),
            measured=Measured(depth=DepthImage(depth=view.depth.astype("float32"))),
        )
    ctx.say(f"{len(found)} captures")
    return Collection[Capture](items=found)
