"""factorize.collision: convex pieces that a simulator can touch, containers kept open."""

from __future__ import annotations

from pydantic import Field, NonNegativeInt, PositiveInt

from dextera_build.artifacts.object import Body, Collision
from dextera_build.rule import Context, Fraction, Options, rule


class CollisionOptions(Options):
    """Options of factorize.collision."""

    convexity: Fraction = 0.97
    """A link whose solid fills this part of its convex hull becomes that hull."""
    cavity_fill: Fraction = 0.05
    """Largest part of a cavity's volume that pieces may cover."""
    pieces: PositiveInt = 96
    """Largest number of pieces of one link."""
    corners: int = Field(192, ge=4)
    """Largest number of corners of one piece."""
    threshold: float = Field(0.06, ge=0.01, le=1.0)
    """Concavity at which CoACD stops, as a part of the link's size."""
    faces: int = Field(1500, ge=4)
    """CoACD works on a mesh simplified to about this many faces."""
    attempts: PositiveInt = 3
    """How often a container is cut finer until `cavity_fill` is met. Attempts, not seconds: results must repeat."""
    seed: NonNegativeInt = 0
    """Seed of CoACD."""


@rule(version=1)
def collision(ctx: Context, body: Body, *, options: CollisionOptions) -> Collision:
    """Return convex pieces of every link in the object frame at joints 0 [m].

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
