"""A baseline of align.object: Open3D's ICP with a free scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import kinematics
from dextera_build.rule import Backend, Context, Options

from . import boxed, overlay_picture
from .placed import Placed

if TYPE_CHECKING:
    from .object import ObjectOptions

BACKEND = Backend(
    summary="a baseline: Open3D's point-to-point ICP with scaling from 24 rotations, the best by fitness",
    packages=("open3d", "scipy"),
    extra="twin",
)


class Open3dOptions(Options):
    """Options of backend `open3d` of align.object."""

    backwards: bool = True
    """Register the seen points to the model; False registers the model to the seen points, which shrinks it."""


def place(ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Open3dOptions) -> Placed:
    """By `boxed.sim3_icp`; the body's own pose is ignored."""
    model, points = boxed.model_points(body), boxed.seen_points(seen)
    found = boxed.sim3_icp(model, points, boxed.upright(model, points), backwards=options.backwards)
    return boxed.judged(body, seen, found, "Open3D ICP with scaling")


def picture(ctx: Context, body: Body, seen: Seen, placement: Placement, options: Open3dOptions) -> np.ndarray:
    """Draw the placed model on the crop, (H, W, 3) uint8."""
    return overlay_picture.draw(*kinematics.posed_surface(body), seen, placement)
