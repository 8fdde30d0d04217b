"""reference.catalogue: published meshes as objects of reference worlds."""

from __future__ import annotations

import io
from pathlib import PurePosixPath
from typing import Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection, Folder
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.scenes.world import Matter, Part, Thing
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import listing
from dextera_build.geometry import convex
from dextera_build.geometry.solids import Solid, join
from dextera_build.rule import ROUNDING, Context, Fraction, Options, Tolerance, rule

UP = {
    "x": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "-x": [[0, -1, 0], [0, 0, 1], [-1, 0, 0]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
}
"""Axis of the file that points up when the object stands -> rotation from the file's frame to the object's."""


class PartOptions(Options):
    """One mesh file of an entry."""

    file: str
    """Path of an OBJ, STL or MSH file in the folder."""
    texture: str | None = None
    """Path of its texture in the folder; requires texture coordinates in the file."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.7, 0.7, 0.7)
    """sRGB colour without a texture."""
    scale: PositiveFloat = 1.0
    """Metres per unit of the file."""


class EntryOptions(Options):
    """One object."""

    parts: tuple[PartOptions, ...] = Field(min_length=1)
    """Its files, which share one frame."""
    up: Literal["x", "-x", "y", "z"] = "z"
    """Axis of the files that points up when the object stands."""
    category: str = "object"
    """Category, for readers of the catalogue."""
    gloss: Fraction = 0.2
    """Strength of highlights, 0..1."""
    density_kg_m3: PositiveFloat = 400.0
    """Mass divided by the volume of the convex hull [kg/m^3]."""


class CatalogueOptions(Options):
    """Options of reference.catalogue."""

    entries: dict[str, EntryOptions]
    """Objects by name."""
    texture_px: PositiveInt = 1024
    """Largest width and height of a texture [px]."""


@rule(version=1, packages=("mujoco", "numpy", "pillow", "scipy"), tolerance=Tolerance({"": ROUNDING}))
def catalogue(ctx: Context, folder: Folder, *, options: CatalogueOptions) -> Collection[Thing]:
    """Return the objects [m], each in its own frame: z up when it rests, the centre of its base at the origin.

    Surfaces are those of the files, which need not be closed.
    """
    items = {}
    for done, (name, entry) in enumerate(options.entries.items()):
        ctx.progress(done, len(options.entries), name)
        for path in (path for part in entry.parts for path in (part.file, part.texture) if path):
            ctx.check(
                path in folder.files,
                f"`{name}` names a file that the folder does not have: `{path}`",
                folders=listing(sorted({known.split("/")[0] for known in folder.files})),
                hint="`make meshes` fetches the files of the benchmark's catalogue",
            )
        items[name] = _thing(folder, entry, options.texture_px)
    faces = sum(len(thing.surface.faces) for thing in items.values())
    ctx.say(f"{len(items)} things, {faces:,} faces")
    return Collection[Thing](items=items)


def _thing(folder: Folder, entry: EntryOptions, texture_px: int) -> Thing:
    meshes = [_mesh(folder, part, np.array(UP[entry.up], np.float64), texture_px) for part in entry.parts]
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    base = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    meshes = [mesh.model_copy(update={"vertices": (mesh.vertices - base).astype(np.float32)}) for mesh in meshes]
    hull, faces = convex.surface(corners - base)
    mass = entry.density_kg_m3 * Solid(hull.astype(np.float64), faces).volume
    return Thing(
        parts={f"part_{number}": Part(mesh=mesh, gloss=entry.gloss) for number, mesh in enumerate(meshes)},
        surface=_joined(meshes),
        pose=Pose(parent="reference", child="thing", matrix=np.eye(4)),
        matter=Matter(mass_kg=max(mass, 0.01), friction=0.5),
    )


def _mesh(folder: Folder, part: PartOptions, turn: np.ndarray, texture_px: int) -> Mesh:
    from dextera_build.sim.model import mesh_file

    read = mesh_file.read(PurePosixPath(part.file).name, folder.files[part.file])
    vertices = (part.scale * read.vertices @ turn.T).astype(np.float32)
    if part.texture is None or read.uv is None:
        return Mesh(vertices=vertices, faces=read.faces, colour=part.colour)
    texture = Image(pixels=_picture(folder.files[part.texture], texture_px))
    return Mesh(vertices=vertices, faces=read.faces, uv=read.uv, texture=texture)


def _picture(data: bytes, most_px: int) -> np.ndarray:
    from PIL import Image as Pillow

    picture = Pillow.open(io.BytesIO(data), formats=("PNG", "JPEG")).convert("RGB")
    picture.thumbnail((most_px, most_px))
    return np.asarray(picture)


def _joined(meshes: list[Mesh]) -> Mesh:
    """All parts as one surface without a texture; coincident corners are merged."""
    whole = join([Solid(mesh.vertices, mesh.faces) for mesh in meshes])
    vertices, place = np.unique(whole.vertices, axis=0, return_inverse=True)
    faces = place.reshape(-1)[whole.faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return Mesh(vertices=vertices, faces=faces[proper].astype(np.int32))
