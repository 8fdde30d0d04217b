"""A baseline of align.object: boxes along principal axes."""

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
    summary="a baseline: boxes along the principal axes of model and seen points, laid onto each other",
    packages=("open3d", "scipy"),
    extra="twin",
)


def place(ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Options) -> Placed:
    """By `boxed.principal`; the body's own pose is ignored."""
    found = boxed.principal(boxed.model_points(body), boxed.seen_points(seen))
    return boxed.judged(body, seen, found, "boxes along principal axes")


def picture(ctx: Context, body: Body, seen: Seen, placement: Placement, options: Options) -> np.ndarray:
    """Draw the placed model on the crop, (H, W, 3) uint8."""
    return overlay_picture.draw(*kinematics.posed_surface(body), seen, placement)
