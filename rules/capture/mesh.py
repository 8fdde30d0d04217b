"""capture.mesh: import a mesh from a file of another program."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import PositiveFloat

from dextera_build.artifacts import mesh_files
from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.mesh_repair import repaired
from dextera_build.geometry.thumbnail import thumbnail
from dextera_build.rule import Context, Options, rule

FOLDER = "mesh"
"""Folder of the scratch space with the input only."""


class MeshOptions(Options):
    """Options of capture.mesh."""

    form: Literal["glb", "obj", "ply", "stl", "usda", "usdc", "usd", "usdz"] = "glb"
    """Format of a single file; files of a folder have their suffixes."""
    path: str = ""
    """The mesh in a folder; "" if it holds only one."""
    unit_m: PositiveFloat = 1.0
    """Length of a unit of the file [m]; for USD, a factor on the unit that it states."""
    up: Literal["x", "y", "z", "file"] = "file"
    """Up axis of the file; `file`: as stated in the file, otherwise y for GLB and z for other formats."""
    repair: bool = False
    """Merge vertices, orient faces consistently and fill holes; a mesh that stays open is refused."""


@rule(version=1, packages=("manifold3d", "numpy", "pillow", "scipy", "trimesh", "usd-core"))
def mesh(ctx: Context, file: File | Folder, *, options: MeshOptions) -> Mesh:
    """Return all triangles of a file as one mesh with one texture, z up, in metres.

    A folder contains the materials, textures and layers that the mesh names; nothing outside of it is read.
    """
    up = None if options.up == "file" else options.up
    path = _placed(ctx, file, options)
    made = mesh_files.load(path, metres_per_unit=options.unit_m, up=up, within=ctx.scratch / FOLDER)
    said = ", ".join(made.facts())
    if options.repair:
        made, report = repaired(made)
        ctx.check(
            report.open_edges == 0,
            f"the mesh stays open after the repair: {report.open_edges:,} edges",
            hint="close it in a modelling program, or leave out `repair`",
            changes=report,
        )
        said = f"{said}; {report}"
    ctx.metric("faces", len(made.faces))
    ctx.metric("closed", float(made.is_closed))
    ctx.preview(thumbnail([(made.vertices[made.faces], made.paint)]), "the mesh")
    ctx.say(said)
    return made


def _placed(ctx: Context, file: File | Folder, options: MeshOptions) -> Path:
    """The mesh as a file, with the files next to it that it names."""
    if isinstance(file, File):
        path = ctx.scratch / FOLDER / f"mesh.{options.form}"
        file.place(path)
        return path
    meshes = sorted(name for name in file.files if Path(name).suffix.lower() in mesh_files.LOADS)
    chosen = [options.path] if options.path else meshes
    if len(chosen) != 1 or chosen[0] not in file.files:
        ctx.fail(
            f"the folder does not hold `{options.path}`" if options.path else f"the folder holds {len(meshes)} meshes",
            meshes=", ".join(meshes) or "none",
            hint="name one of them in `path`",
        )
    file.export(ctx.scratch / FOLDER, "mesh")
    return ctx.scratch / FOLDER / chosen[0]
