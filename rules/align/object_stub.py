"""Backend stub of align.object: takes the body's own pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.object import Body, Placement
from dextera_build.artifacts.view import Seen
from dextera_build.rule import Backend, Context, Options

from .placed import Placed

if TYPE_CHECKING:
    from .object import ObjectOptions

BACKEND = Backend(summary="the body's own pose at scale 1, for tests", profiles=("stub",))


def place(ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Options) -> Placed:
    """The guess, unscaled and unchecked."""
    placement = Placement(pose=body.pose, scale=1.0, residual_m=0.0, overlap=1.0, method="guess, unchecked")
    return Placed(placement, iou=1.0, violation=0.0, gap_m=0.0)


def picture(ctx: Context, body: Body, seen: Seen, placement: Placement, options: Options) -> None:
    """Draw nothing."""
