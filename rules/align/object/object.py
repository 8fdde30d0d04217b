"""align.object: pose and scale of a body."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.artifacts.objects.view import MeasuredView, ObjectView, Seen
from dextera_build.rule import ROUNDING, Context, Fraction, Options, Tolerance, rule

from .placed import Placed


class ObjectOptions(Options):
    """Options of align.object."""

    least_iou: Fraction = 0.3
    """Mask IoU below which the placement is rejected."""
    most_violation: Fraction = 0.5
    """Fraction of the rendered pixels in free space above which the placement is rejected."""


class PlacementBackend(Protocol):
    """Interface of a backend of align.object."""

    def place(self, ctx: Context, body: Body, seen: Seen, common: ObjectOptions, options: Any) -> Placed:
        """Find pose and scale of the body in the view."""
        ...

    def picture(self, ctx: Context, body: Body, seen: Seen, placement: Placement, options: Any) -> np.ndarray | None:
        """Draw the placed body on the crop, (H, W, 3) uint8; None for no picture."""
        ...


@rule(version=3, tolerance=Tolerance({"": ROUNDING}))
def object(
    ctx: Context[PlacementBackend],
    body: Body,
    view: ObjectView,
    measured: MeasuredView | None = None,
    support: Support | None = None,
    *,
    options: ObjectOptions | None = None,
) -> Placement:
    """Return the pose of the object frame in the world and the scale from mesh units to those of the world [m].

    The result is judged by its render, not by the registration's fitness, which is perfect for a collapsed fit. A poor
    result is refused, or causes a warning if the body was fitted to this view and has its own pose. Without depth, the
    body stands on the support and only its silhouette is compared.
    """
    options = options or ObjectOptions()
    seen = _seen(ctx, view, measured, support)
    valid = int((seen.mask & (seen.depth > 0.0)).sum())
    if measured is not None and valid < 50:
        ctx.fail(f"only {valid} pixels of the object have depth", hint="drop the element, or capture it nearer")
    placed = ctx.backend.place(ctx, body, seen, options, ctx.backend_options)
    bad = misfit(placed, options)
    if bad and measured is not None and body.pose is not None:
        # It was fitted to the depth of this view, so its pose is right even if its shape is poor.
        ctx.warn(bad)
    else:
        hint = "try another backend of `factorize.mesh`, or look at the mask of this object"
        ctx.check(not bad, bad, hint=hint, method=placed.placement.method)
    placement = placed.placement.model_copy(update={"asset_source": body.asset_source})
    pixels = ctx.backend.picture(ctx, body, seen, placement, ctx.backend_options)
    if pixels is not None:
        ctx.preview(pixels, "outline and hidden half of the placed mesh on the photograph")
    residual = ""
    if placement.residual_m is not None:
        residual = f"residual {placement.residual_m * 1000:.1f} mm, "
        ctx.metric("residual", placement.residual_m * 1000.0, "mm")
    for name, value, unit in (
        ("scale", placement.scale, ""),
        ("mask_iou", placed.iou, ""),
        ("free_space", placed.violation * 100.0, "%"),
        ("gap", placed.gap_m * 1000.0, "mm"),
    ):
        ctx.metric(name, value, unit)
    turn = ", turn undetermined" if placement.ambiguous else ""
    ctx.say(f"scale {placement.scale:.4f}, IoU {placed.iou:.2f}, {residual}{placement.method}{turn}")
    return placement


def misfit(placed: Placed, options: ObjectOptions) -> str:
    """Reason for rejecting a placement; empty for a good one."""
    if placed.iou < options.least_iou:
        return f"the placed render covers the mask with IoU {placed.iou:.2f}, {options.least_iou:.2f} is needed"
    if placed.violation > options.most_violation:
        return f"{placed.violation:.0%} of the placed render is in free space, {options.most_violation:.0%} is allowed"
    return ""


def _seen(ctx: Context, view: ObjectView, measured: MeasuredView | None, support: Support | None) -> Seen:
    """View and measurements; without depth, no pixel is measured and the camera's pose is the support's."""
    if measured is not None:
        return Seen(view, measured)
    if support is None:
        ctx.fail(
            "the object has no measured depth, and no support is given",
            hint="give the input `support`, or add the depth to the capture",
        )
    return Seen.without_depth(view, support.camera_pose)
