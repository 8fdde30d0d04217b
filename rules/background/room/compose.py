"""background.compose: one representation of the static scene from many views of it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.geometry import metrics
from dextera_build.rule import ROUNDING, Context, Tolerance, rule


class ComposeBackend(Protocol):
    """Interface of a backend of background.compose."""

    def compose(self, ctx: Context, views: Views, background: Background | None, options: Any) -> Room:
        """Gaussians and points in the frame of the views [m], and depth by the views' names if it is estimated."""
        ...


# Trained Gaussians differ between processors, as all trained parameters do; Gaussians that are only placed do not.
@rule(
    version=1,
    packages=("numpy", "pillow"),
    tolerance=Tolerance({"": ROUNDING, "splats": 0.1, "splats.means": 0.03}, metrics={"first view": 0.5}),
)
def compose(ctx: Context[ComposeBackend], views: Views, background: Background | None = None) -> Room:
    """Return 3D Gaussians and points of the surfaces in the views, in their frame [m].

    The first view is rendered again from the Gaussians and compared with its picture.
    """
    made: Room = ctx.backend.compose(ctx, views, background, ctx.backend_options)
    source = "rgb" if background is None else background.asset_source
    room = made.model_copy(update={"asset_source": source})
    ctx.check(len(room.splats.means) > 0, "there is no Gaussian")
    ctx.check(room.splats.frame == views.frame, "the Gaussians left the frame of the views", frame=room.splats.frame)
    for name, image in room.depth.items():
        ctx.check(name in views.names, f"there is depth of `{name}`, which is no view")
        size, wanted = image.depth.shape, (views.lens(name).height, views.lens(name).width)
        ctx.check(size == wanted, f"the depth of `{name}` is of another size", depth=f"{size}", picture=f"{wanted}")
    ctx.metric("Gaussians", len(room.splats.means))
    likeness = _compared(ctx, views, room)
    ctx.say(f"{len(room.splats.means):,} Gaussians of {len(views.names)} views{likeness}, {source}")
    return room


def _compared(ctx: Context[ComposeBackend], views: Views, room: Room) -> str:
    """Render the first view again; `, the first one at 31.2 dB`, or "" for lenses other than pinholes."""
    name = views.names[0]
    lens = views.lens(name)
    if not isinstance(lens, Camera):
        return ""
    picture, again = views.pixels(name), room.splats.seen(lens, views.pose(name)).pixels
    decibels = metrics.psnr(picture, again, np.ones(picture.shape[:2], bool))
    ctx.preview(np.hstack([picture, again]), "the first view, and the Gaussians from there")
    if decibels is None:
        return ""
    ctx.metric("first view", decibels, "dB")
    return f", the first one at {decibels:.1f} dB"
