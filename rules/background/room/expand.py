"""background.expand: pictures of the static scene from virtual cameras."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.views import Views
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class ExpandOptions(Options):
    """Options of background.expand."""

    longest_px: int = Field(640, ge=16, le=4096)
    """Longest side of the pictures, at most the photograph's own [px]."""


class ExpandBackend(Protocol):
    """Interface of a backend of background.expand."""

    def expand(
        self,
        ctx: Context,
        panorama: Panorama,
        paths: Collection[Trajectory],
        background: Background,
        camera: Camera,
        options: Any,
    ) -> Views:
        """Pictures along the paths, in frame `world` [m], the first one from near the panorama's position.

        `camera` is the virtual camera. Known surfaces are in `Views.points` with their colours.
        """
        ...


@rule(version=2, packages=("numpy", "pillow"), tolerance=Tolerance({"": ROUNDING}))
def expand(
    ctx: Context[ExpandBackend],
    panorama: Panorama,
    paths: Collection[Trajectory],
    background: Background,
    camera: Camera,
    *,
    options: ExpandOptions | None = None,
) -> Views:
    """Return the pictures of virtual cameras on the paths, with their poses in the world frame [m].

    The virtual cameras have the field of view of the photograph's `camera`.
    """
    virtual = smaller(camera, (options or ExpandOptions()).longest_px)
    views: Views = ctx.backend.expand(ctx, panorama, paths, background, virtual, ctx.backend_options)
    ctx.check(len(views.names) > 0, "there is no view", hint="the paths hold no camera")
    ctx.check(views.frame == "world", "the views are not in the world frame", frame=views.frame)
    count = 0 if views.points is None else len(views.points.points)
    ctx.metric("views", len(views.names))
    ctx.say(f"{len(views.names)} views of {virtual.width} x {virtual.height} px, {count:,} points")
    shown = [views.pixels(views.names[place]) for place in (0, len(views.names) // 2, -1)]
    ctx.preview(np.hstack([pixels[::2, ::2] for pixels in shown]), "the first view, one of the middle, and the last")
    return views


def smaller(camera: Camera, longest: int) -> Camera:
    """The camera with the same field of view and at most `longest` pixels a side."""
    return camera.scaled(min(1.0, longest / max(camera.width, camera.height)))
