"""align.object: pose and scale of a body."""

from __future__ import annotations

from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.object import Body, ObjectView, Placement
from dextera_build.rule import Context, Fraction, Options, rule


class ObjectOptions(Options):
    """Options of align.object."""

    guess_iou: Fraction = 0.6
    """Mask IoU from which the body's own pose is refined; below it every orientation is tried."""
    guess_scale_sigma: PositiveFloat = 0.003
    """Relative standard deviation of the scale if the body's own pose is good: it was measured in metres."""
    start_scale_sigma: PositiveFloat = 0.10
    """Relative standard deviation of the scale from extent ratios."""
    gain: NonNegativeFloat = 0.01
    """Minimum improvement of the render score for a refined pose to replace the guess."""
    search_gain: NonNegativeFloat = 0.1
    """Minimum improvement of the render score for a pose found from scratch to replace a poor guess."""
    rest_m: NonNegativeFloat = 0.02
    """Maximum distance from the support of the lowest point of a body that stands on it [m]."""
    iterations: PositiveInt = 40
    """Iterations of the final refinement."""
    finalists: PositiveInt = 6
    """Number of starts refined after coarse scoring."""
    least_iou: Fraction = 0.3
    """Mask IoU below which the placement is rejected."""
    most_violation: Fraction = 0.5
    """Fraction of the rendered pixels in free space above which the placement is rejected."""


@rule(version=1)
def object(ctx: Context, body: Body, seen: ObjectView, *, options: ObjectOptions) -> Placement:
    """Return the pose of the object frame in the world and the scale from mesh units to metres [m].

    The backend offers `place(body, seen, options) -> placed.Placed` and `picture(body, seen, placement)`. The
    render decides, not the registration's fitness, which is perfect for a collapsed fit.
    """
    valid = int((seen.mask & (seen.depth.depth > 0.0)).sum())
    if valid < 50:
        ctx.fail(f"only {valid} pixels of the object have depth", hint="drop the element, or capture it nearer")
    placed = ctx.backend.place(body, seen, options)
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
    placement: Placement = placed.placement
    pixels = ctx.backend.picture(body, seen, placement)
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
