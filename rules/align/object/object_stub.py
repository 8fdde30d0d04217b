"""Backend stub of align.object: uses the body's own pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Body, Placement
from dextera_build.artifacts.objects.view import Seen
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import Backend, Context, Options

from .placed import Placed

if TYPE_CHECKING:
    from .object import ObjectOptions

BACKEND = Backend(summary="the body's own pose at scale 1, for tests", profiles=("stub",))


def place(ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Options) -> Placed:
    """The body's own pose, unscaled and unchecked; the world's origin if there is none."""
    pose = body.pose or Pose(parent="world", child="object", matrix=np.eye(4))
    placement = Placement(pose=pose, scale=1.0, residual_m=0.0, overlap=1.0, method="guess, unchecked")
    return Placed(placement, iou=1.0, violation=0.0, gap_m=0.0)


def picture(ctx: Context, body: Body, seen: Seen, placement: Placement, options: Options) -> None:
    """Draw nothing."""
