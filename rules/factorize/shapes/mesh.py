"""factorize.mesh: complete the surface of a partly seen object."""

from __future__ import annotations

import math
from typing import Any, Protocol

from pydantic import PositiveInt

from dextera_build.artifacts.objects.object import Shape, Support
from dextera_build.artifacts.objects.view import FurtherViews, MeasuredView, ObjectView, Seen
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule

from ..measured import Measurements, of_view
from .evidence import LEAST_POINTS
from .picture import picture


class MeshOptions(Options):
    """Options of factorize.mesh; every field is part of the key."""

    texture_px: PositiveInt = 1024
    """Largest width and height of the texture [px]."""
    least_points: PositiveInt = LEAST_POINTS
    """Minimum number of trusted depth pixels in a view."""


class MeshBackend(Protocol):
    """Interface of a backend of factorize.mesh."""

    def complete(
        self, ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: Any
    ) -> Shape:
        """The closed, textured body that explains the view."""
        ...


# Corners that rounding moves by less than anything measurable can be joined by other triangles, each with its own place
# in the texture.
@rule(
    version=4,
    packages=("numpy",),
    tolerance=Tolerance({"": ROUNDING, "mesh.faces": math.inf, "mesh.uv": math.inf, "mesh.texture": math.inf}),
)
def mesh(
    ctx: Context[MeshBackend],
    view: ObjectView,
    measured: MeasuredView | None = None,
    support: Support | None = None,
    further: FurtherViews | None = None,
    *,
    options: MeshOptions | None = None,
) -> Shape:
    """Return a closed, textured mesh of the object, origin at the centre of the base, z up in its photographed pose.

    The result of a backend that reads `measured` is in metres and labelled `rgbd`; for any other, `align.object` finds
    the scale. `support` tells backends without depth where the camera is. `further` are views of the object in further
    photographs, which backend `primitives` fits together with the first one.
    """
    options = options or MeshOptions()
    depth = of_view(ctx, view, measured, support, further)
    made: Shape = ctx.backend.complete(ctx, view, depth, options, ctx.backend_options)
    shape = made.model_copy(update={"asset_source": depth.source(view.asset_source)})
    lowest = float(shape.mesh.vertices[:, 2].min())
    ctx.check(shape.mesh.is_closed, "the mesh is open", hint="use backend `stub`", faces=len(shape.mesh.faces))
    ctx.check(abs(lowest) < 1e-4, "the base is not at z = 0", lowest=f"{lowest * 1000:.2f} mm")
    shown = [] if further is None else [*zip((one.file for one in further.items), shape.further_seen, strict=False)]
    ctx.say(describe(shape) + "".join(f", {name} shows {100 * share:.0f} % more" for name, share in shown))
    for name, share in shown:
        ctx.metric(f"seen by {name} only", 100.0 * share, "%")
    ctx.metric("mask IoU", shape.mask_iou)
    if shape.residual_m is not None:
        ctx.metric("depth residual", shape.residual_m * 1000.0, "mm")
    ctx.metric("unseen surface", shape.unseen_fraction * 100.0, "%")
    pixels = picture(shape, view, measured)
    if pixels is not None:
        ctx.preview(pixels, f"{describe(shape)}; crop, overlay, and the body from two other sides")
    return shape


def describe(shape: Shape) -> str:
    """`revolved, hollow, 84 x 84 x 105 mm, 1.8 mm residual, 41 % unseen, rgbd`."""
    family = shape.hypothesis.replace("_hollow", "").replace("_", " ")
    size = " x ".join(f"{length * 1000:.0f}" for length in shape.mesh.extent)
    hollow = ", hollow" if shape.hollow else ""
    guessed = f" ({' and '.join(shape.unobserved)} guessed)" if shape.unobserved else ""
    residual = "" if shape.residual_m is None else f", {shape.residual_m * 1000:.1f} mm residual"
    unseen = f"{shape.unseen_fraction * 100:.0f} % unseen"
    return f"{family}{hollow}, {size} mm{guessed}{residual}, {unseen}, {shape.asset_source}"
