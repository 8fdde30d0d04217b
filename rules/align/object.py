"""align.object: pose and scale of a body."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.object import Body, Placement
from dextera_build.artifacts.view import MeasuredView, ObjectView, Seen
from dextera_build.rule import Context, Fraction, Options, rule

from .placed import Placed


class ObjectOptions(Options):
    """Options of align.object."""

    least_iou: Fraction = 0.3
    """Mask IoU below which the placement is rejected."""
    most_violation: Fraction = 0.5
    """Fraction of the rendered pixels in free space above which the placement is rejected."""


class PlacementBackend(Protocol):
    """What a backend of align.object defines."""

    def place(self, ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Any) -> Placed:
        """Find pose and scale of the body in the view."""
        ...

    def picture(self, ctx: Context, body: Body, seen: Seen, placement: Placement, options: Any) -> np.ndarray | None:
        """Draw the placed body on the crop, (H, W, 3) uint8; None for no picture."""
        ...


@rule(version=2)
def object(
    ctx: Context[PlacementBackend],
    body: Body,
    view: ObjectView,
    measured: MeasuredView | None = None,
    *,
    options: ObjectOptions | None = None,
) -> Placement:
    """Return the pose of the object frame in the world and the scale from mesh units to metres [m].

    The render decides, not the registration's fitness, which is perfect for a collapsed fit.
    """
    options = options or ObjectOptions()
    if measured is None:
        ctx.fail("the object has no measured depth", hint="add the depth to the capture")
    seen = Seen(view, measured)
    valid = int((seen.mask & (seen.depth > 0.0)).sum())
    if valid < 50:
        ctx.fail(f"only {valid} pixels of the object have depth", hint="drop the element, or capture it nearer")
    placed = ctx.backend.place(ctx, body, seen, options, ctx.backend_options)
    hint = "try another backend of `factorize.mesh`, or look at the mask of this object"
    ctx.check(
        placed.iou >= options.least_iou,
        f"the placed render covers the mask with IoU {placed.iou:.2f}, {options.least_iou:.2f} is needed",
        hint=hint,
        method=placed.placement.method,
    )
    ctx.check(
        placed.violation <= options.most_violation,
        f"{placed.violation:.0%} of the placed render lies in free space, {options.most_violation:.0%} is allowed",
        hint=hint,
        method=placed.placement.method,
    )
    placement = placed.placement.model_copy(update={"asset_source": body.asset_source})
    pixels = ctx.backend.picture(ctx, body, seen, placement, ctx.backend_options)
    if pixels is not None:
        ctx.preview(pixels, "outline and hidden half of the placed mesh on the photograph")
    for name, value, unit in (
        ("scale", placement.scale, ""),
        ("residual", placement.residual_m * 1000.0, "mm"),
        ("mask_iou", placed.iou, ""),
        ("free_space", placed.violation * 100.0, "%"),
        ("gap", placed.gap_m * 1000.0, "mm"),
    ):
        ctx.metric(name, value, unit)
    turn = ", turn undetermined" if placement.ambiguous else ""
    ctx.say(
        f"scale {placement.scale:.4f}, IoU {placed.iou:.2f}, residual {placement.residual_m * 1000:.1f} mm, "
        f"{placement.method}{turn}"
    )
    return placement
