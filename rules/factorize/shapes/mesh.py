"""factorize.mesh: complete the surface of a partly seen object."""

from __future__ import annotations

from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.object import ObjectView, Shape
from dextera_build.rule import Context, Options, rule

from .families.names import HYPOTHESES
from .picture import picture


class MeshOptions(Options):
    """Options of factorize.mesh; every field is part of the key."""

    hypotheses: tuple[str, ...] = HYPOTHESES
    """Body families to fit."""
    wall_m: PositiveFloat = 0.003
    """Wall thickness of a vessel if the view does not show it [m]."""
    texture_px: PositiveInt = 1024
    """Largest width and height of the texture [px]."""
    refine_steps: NonNegativeInt = 14
    """Maximum least-squares steps per hypothesis; the best one gets three times as many."""
    least_points: PositiveInt = 150
    """Minimum number of trusted depth pixels in a view."""


@rule(version=1, packages=("numpy",))
def mesh(ctx: Context, seen: ObjectView, *, options: MeshOptions) -> Shape:
    """Return a closed, textured mesh of the object [m], origin at the centre of the base, z up as it stands."""
    shape: Shape = ctx.backend.complete(ctx, seen, options)
    lowest = float(shape.mesh.vertices[:, 2].min())
    ctx.check(shape.mesh.is_closed, "the mesh is open", hint="use backend `stub`", faces=len(shape.mesh.faces))
    ctx.check(abs(lowest) < 1e-4, "the base is not at z = 0", lowest=f"{lowest * 1000:.2f} mm")
    ctx.say(describe(shape))
    ctx.metric("mask IoU", shape.mask_iou)
    ctx.metric("depth residual", shape.residual_m * 1000.0, "mm")
    ctx.metric("unseen surface", shape.unseen_fraction * 100.0, "%")
    pixels = picture(shape, seen)
    if pixels is not None:
        ctx.preview(pixels, f"{describe(shape)}; crop, overlay, and the body from two other sides")
    return shape


def describe(shape: Shape) -> str:
    """`revolved, hollow, 84 x 84 x 105 mm, 1.8 mm residual, 41 % unseen`."""
    family = shape.hypothesis.replace("_hollow", "").replace("_", " ")
    size = " x ".join(f"{length * 1000:.0f}" for length in shape.mesh.extent)
    hollow = ", hollow" if shape.hollow else ""
    guessed = f" ({' and '.join(shape.unobserved)} guessed)" if shape.unobserved else ""
    residual = f"{shape.residual_m * 1000:.1f} mm residual"
    return f"{family}{hollow}, {size} mm{guessed}, {residual}, {shape.unseen_fraction * 100:.0f} % unseen"
