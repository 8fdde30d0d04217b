"""reference.exchange: objects of a reference world are exchanged for published ones."""

from __future__ import annotations

import itertools

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.world import Matter, Thing, World
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Context, Options, rule

from . import solids


class ExchangedOptions(Options):
    """What takes an object's place."""

    thing: str
    """Its name among the things."""
    yaw_deg: float = 0.0
    """Rotation about z [deg]."""
    scale: PositiveFloat = 1.0
    """Size, as a multiple of the thing's own."""
    mass_kg: PositiveFloat
    """Mass [kg]."""
    friction: PositiveFloat = 0.45
    """Sliding friction coefficient."""
    restitution: float = Field(0.15, ge=0.0, lt=1.0)
    """Coefficient of restitution of a slow impact on the table."""


class ExchangeOptions(Options):
    """Options of reference.exchange."""

    objects: dict[str, ExchangedOptions] = Field(min_length=1)
    """Objects of the world, by name, and what takes their places."""


@rule(version=1, packages=("manifold3d", "numpy"))
def exchange(ctx: Context, world: World, things: Collection[Thing], *, options: ExchangeOptions) -> World:
    """Return the world in which other things, such as those of `reference.catalogue`, replace some objects [m].

    The middle of a thing's base comes to where the object's was. Its parts must be closed, because its centre of mass
    is that of their volume, and it needs convex pieces.
    """
    objects = dict(world.objects)
    for name, put in options.objects.items():
        ctx.check(name in objects, f"the world has no object `{name}`", objects=listing(objects))
        ctx.check(put.thing in things.items, f"there is no thing `{put.thing}`", things=listing(things.items))
        objects[name] = _placed(things.items[put.thing], objects[name].pose.matrix, put)
        _check(ctx, put.thing, objects[name])
    for one, other in itertools.combinations(objects, 2):
        if {one, other} & set(options.objects):
            apart = solids.gap(_posed(objects[one]), _posed(objects[other])) > 0
            ctx.check(apart, f"`{one}` and `{other}` run into each other", hint="take something smaller, or turn it")
    ctx.say(", ".join(f"{name} is {put.thing}" for name, put in options.objects.items()))
    return world.model_copy(update={"objects": objects})


def _placed(thing: Thing, stood: np.ndarray, options: ExchangedOptions) -> Thing:
    pose = transforms.rigid(lie.about_z(np.radians(options.yaw_deg)), stood[:3, 3])
    matter = Matter(mass_kg=options.mass_kg, friction=options.friction, restitution=options.restitution)
    parts = {}
    for name, part in thing.parts.items():
        pieces = tuple(Hull(vertices=piece.vertices * np.float32(options.scale)) for piece in part.pieces)
        parts[name] = part.model_copy(update={"mesh": _scaled(_merged(part.mesh), options.scale), "pieces": pieces})
    return Thing(
        parts=parts,
        surface=_scaled(thing.surface, options.scale),
        pose=Pose(parent="reference", child="thing", matrix=pose),
        matter=matter,
    )


def _scaled(mesh: Mesh, scale: float) -> Mesh:
    return mesh.model_copy(update={"vertices": mesh.vertices * np.float32(scale)})


def _merged(mesh: Mesh) -> Mesh:
    """The same surface with common corners of its faces, which files with a texture often repeat."""
    vertices, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = number.reshape(-1)[mesh.faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    uv = None if mesh.uv is None else mesh.uv[proper]
    return mesh.model_copy(update={"vertices": vertices, "faces": faces[proper].astype(np.int32), "uv": uv})


def _check(ctx: Context, name: str, thing: Thing) -> None:
    closed = all(part.mesh.is_closed for part in thing.parts.values())
    ctx.check(closed, f"the surface of `{name}` is open")
    pieces = any(part.pieces for part in thing.parts.values())
    ctx.check(pieces, f"`{name}` has no convex pieces", hint="give the things through `reference.convex_pieces`")


def _posed(thing: Thing) -> Mesh:
    return solids.moved(thing.surface, thing.pose.matrix)
