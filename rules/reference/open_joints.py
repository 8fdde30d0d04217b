"""reference.open_joints: a world with hinges in other positions, for a second photograph of the same objects."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from dextera_build.artifacts.scenes.world import Part, Thing, World
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.errors import did_you_mean, listing
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Context, Options, rule

from . import solids


class OpenJointsOptions(Options):
    """Options of reference.open_joints."""

    positions_deg: dict[str, float] = Field(min_length=1)
    """Object -> position of its hinge [deg]."""


@rule(version=1, packages=("numpy", "manifold3d"))
def open_joints(ctx: Context, world: World, *, options: OpenJointsOptions) -> World:
    """Return the same world with hinges in other positions; the fixed parts do not move.

    Raises:
        RuleError: There is no such object, it has no hinge, or the position is beyond its limits.
    """
    objects = dict(world.objects)
    hinged = [name for name, thing in objects.items() if thing.hinge is not None]
    for name, degrees in options.positions_deg.items():
        if name not in hinged:
            ctx.fail(
                f"the world has no object `{name}` with a hinge",
                hint=did_you_mean(name, hinged) or "name one of them in `positions_deg`",
                hinged=listing(hinged) or "none",
            )
        objects[name] = _at(ctx, name, objects[name], float(np.radians(degrees)))
    told = ", ".join(f"{name} at {degrees:.0f} deg" for name, degrees in options.positions_deg.items())
    ctx.say(told)
    return world.model_copy(update={"objects": objects})


def _at(ctx: Context, name: str, thing: Thing, position: float) -> Thing:
    hinge = thing.hinge
    assert hinge is not None
    ctx.check(
        hinge.lower <= position <= hinge.upper,
        f"the hinge of `{name}` does not go to {np.degrees(position):.0f} deg",
        hint="choose a position within its limits",
        limits_deg=f"{np.degrees(hinge.lower):.0f} to {np.degrees(hinge.upper):.0f}",
    )
    motion = lie.turned(np.array(hinge.axis), np.array(hinge.origin), position - hinge.position)
    parts = {key: _moved(part, motion) if key in hinge.parts else part for key, part in thing.parts.items()}
    return thing.model_copy(
        update={
            "parts": parts,
            "surface": solids.union([part.mesh for part in parts.values()]),
            "hinge": hinge.model_copy(update={"position": position}),
        }
    )


def _moved(part: Part, motion: np.ndarray) -> Part:
    mesh: Mesh = solids.moved(part.mesh, motion)
    pieces = tuple(Hull(vertices=_applied(motion, hull.vertices)) for hull in part.pieces)
    return part.model_copy(update={"mesh": mesh, "pieces": pieces})


def _applied(motion: np.ndarray, points: np.ndarray) -> np.ndarray:
    return transforms.apply(motion, points.astype(np.float64)).astype(np.float32)
