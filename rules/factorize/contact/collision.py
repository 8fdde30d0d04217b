"""factorize.collision: convex collision pieces for simulation; containers stay open."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field

from dextera_build.artifacts.objects.object import Body, Collision, Link, Pieces
from dextera_build.rule import Context, Fraction, Options, rule


class CollisionOptions(Options):
    """Options of factorize.collision."""

    cavity_fill: Fraction = 0.05
    """Largest fraction of a cavity's volume that pieces may fill."""
    corners: int = Field(192, ge=4)
    """Maximum number of corners per piece."""


class CollisionBackend(Protocol):
    """Interface of a backend of factorize.collision."""

    def pieces(self, ctx: Context, link: Link, hollow: bool, common: CollisionOptions, options: Any) -> Pieces:
        """Convex pieces of one link [m, object]."""
        ...

    def picture(self, ctx: Context, collision: Collision, options: Any) -> np.ndarray | None:
        """Draw the pieces, (H, W, 3) uint8; None for no picture."""
        ...


@rule(version=2)
def collision(ctx: Context[CollisionBackend], body: Body, *, options: CollisionOptions) -> Collision:
    """Return convex pieces of every link, in the object frame with all joints at 0 [m].

    The backend offers `pieces(link, hollow, options) -> Pieces` and `picture(body, collision) -> pixels or None`.
    """
    links = {}
    for number, (name, link) in enumerate(body.links.items()):
        ctx.progress(number, len(body.links), name)
        made = ctx.backend.pieces(ctx, link, body.hollow, options, ctx.backend_options)
        ctx.check(len(made.hulls) > 0, f"link `{name}` has no collision piece", hint="use backend `stub`: one hull")
        ctx.metric(f"{name}.pieces", len(made.hulls))
        if made.cavity_fill is not None:
            ctx.metric(f"{name}.cavity_fill", made.cavity_fill * 100.0, "%")
        if made.excess is not None and made.lacking is not None:
            ctx.metric(f"{name}.excess", made.excess * 100.0, "%")
            ctx.metric(f"{name}.lacking", made.lacking * 100.0, "%")
        links[name] = made
    result = Collision(links=links)
    pixels = ctx.backend.picture(ctx, result, ctx.backend_options)
    if pixels is not None:
        ctx.preview(pixels, "collision pieces, one colour each")
    ctx.say("; ".join(_line(name, result, options) for name in links))
    return result


def _line(name: str, result: Collision, options: CollisionOptions) -> str:
    made = result.links[name]
    line = f"{name}: {len(made.hulls)} by {made.method}"
    if made.cavity_fill is not None:
        missed = "" if made.cavity_fill <= options.cavity_fill else f", {options.cavity_fill:.0%} was requested"
        line += f", cavity filled {made.cavity_fill:.1%}{missed}"
    if made.excess is not None and made.lacking is not None:
        line += f", volume +{made.excess:.1%} -{made.lacking:.1%}"
    return line
