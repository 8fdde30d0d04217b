"""align.scale: the support in metres."""

from __future__ import annotations

import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.errors import did_you_mean, listing
from dextera_build.geometry import boxes, kinematics, transforms
from dextera_build.rule import Context, Options, rule


class ScaleOptions(Options):
    """Options of align.scale: one known size, for photographs without depth, marker and robot."""

    size_m: PositiveFloat | None = None
    """Longest edge of the smallest upright box around one object in its photographed pose [m]."""
    object: str = ""
    """Name of that object; empty if there is only one."""


@rule(version=1, packages=("numpy", "scipy"))
def scale(
    ctx: Context,
    support: Support,
    bodies: Collection[Body],
    placements: Collection[Placement],
    *,
    options: ScaleOptions | None = None,
) -> Support:
    """Return the support in metres, or unchanged if its scale is known already or remains unknown.

    A stated size multiplies all lengths of the world by one factor, `Support.factor`, about the world's origin.
    """
    options = options or ScaleOptions()
    if options.size_m is None:
        if options.object:
            ctx.fail(f"`object: {options.object}` has no size", hint="state `size_m`, the longest edge of its box, too")
        ctx.say("scale unknown" if support.scale == "unknown" else f"scale by the {support.scale}")
        return support
    if support.scale != "unknown":
        ctx.fail(
            f"the scale is known by the {support.scale}, and `size_m` states it again",
            hint="leave out `size_m`",
        )
    name = _named(ctx, bodies, options.object)
    points = kinematics.posed_surface(bodies.items[name])[0]
    placed = placements.items[name]
    size, _ = boxes.upright_box(transforms.apply(placed.pose.matrix, placed.scale * points))
    factor = options.size_m / float(max(size))
    ctx.metric("factor", factor)
    ctx.say(f"scale by the size of {name}, {1000 * options.size_m:.0f} mm; the camera is at {_height(support, factor)}")
    matrix = support.camera_pose.matrix.copy()
    matrix[:3, 3] *= factor
    return support.model_copy(
        update={
            "camera_pose": support.camera_pose.model_copy(update={"matrix": matrix}),
            "polygon": np.ascontiguousarray(support.polygon * factor),
            "scale": "size",
            "factor": factor,
        }
    )


def _named(ctx: Context, bodies: Collection[Body], name: str) -> str:
    known = listing(bodies.items)
    if not name:
        ctx.check(len(bodies.items) == 1, "`size_m` is the size of which object?", objects=known, hint="set `object`")
        return next(iter(bodies.items))
    if name not in bodies.items:
        ctx.fail(f"no object is called `{name}`", objects=known, hint=did_you_mean(name, bodies.items))
    return name


def _height(support: Support, factor: float) -> str:
    return f"{support.camera_pose.matrix[2, 3] * factor:.2f} m"
