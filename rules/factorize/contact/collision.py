"""factorize.collision: convex collision pieces for simulation; containers stay open."""

from __future__ import annotations

from pydantic import Field, NonNegativeInt, PositiveInt

from dextera_build.artifacts.object import Body, Collision
from dextera_build.rule import Context, Fraction, Options, rule


class CollisionOptions(Options):
    """Options of factorize.collision."""

    convexity: Fraction = 0.97
    """A link whose solid fills at least this fraction of its convex hull is replaced by the hull."""
    cavity_fill: Fraction = 0.05
    """Largest fraction of a cavity's volume that pieces may fill."""
    pieces: PositiveInt = 96
    """Maximum number of pieces per link."""
    corners: int = Field(192, ge=4)
    """Maximum number of corners per piece."""
    threshold: float = Field(0.06, ge=0.01, le=1.0)
    """Concavity at which CoACD stops, as a fraction of the link's size."""
    faces: int = Field(1500, ge=4)
    """Approximate number of faces of the simplified mesh passed to CoACD."""
    attempts: PositiveInt = 3
    """Maximum number of finer cuts to meet `cavity_fill`; a count, not a time limit, for reproducible results."""
    seed: NonNegativeInt = 0
    """Seed of CoACD."""


@rule(version=1)
def collision(ctx: Context, body: Body, *, options: CollisionOptions) -> Collision:
    """Return convex pieces of every link, in the object frame with all joints at 0 [m].

    The backend offers `pieces(link, hollow, options) -> Pieces` and `picture(body, collision) -> pixels or None`.
    """
    links = {}
    for number, (name, link) in enumerate(body.links.items()):
        ctx.progress(number, len(body.links), name)
        made = ctx.backend.pieces(link, body.hollow, options)
        ctx.check(len(made.hulls) > 0, f"link `{name}` has no collision piece", hint="use backend `stub`: one hull")
        ctx.metric(f"{name}.pieces", len(made.hulls))
        if made.cavity_fill is not None:
            ctx.metric(f"{name}.cavity_fill", made.cavity_fill * 100.0, "%")
        links[name] = made
    result = Collision(links=links)
    pixels = ctx.backend.picture(result)
    if pixels is not None:
        ctx.preview(pixels, "collision pieces, one colour each")
    ctx.say("; ".join(_line(name, result, options) for name in links))
    return result


def _line(name: str, result: Collision, options: CollisionOptions) -> str:
    made = result.links[name]
    line = f"{name}: {len(made.hulls)} by {made.method}"
    if made.cavity_fill is None:
        return line
    missed = "" if made.cavity_fill <= options.cavity_fill else f", {options.cavity_fill:.0%} was asked"
    return f"{line}, cavity filled {made.cavity_fill:.1%}{missed}"
