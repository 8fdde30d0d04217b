"""Conversion of a generator's mesh file, in its own unit and pose, to a `Shape`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.mesh_repair import repaired
from dextera_build.formats.mesh import load
from dextera_build.rule import Context

from ..contact import cavity
from .outline import explain

_HOLLOW = 0.1
"""A body is hollow if its cavity is at least this fraction of body and cavity together."""


def shape_of(ctx: Context, data: bytes, suffix: str, view: ObjectView, made_by: str, texture_px: int) -> Shape:
    """The closed mesh, standing on z = 0 above the middle of its base, without a pose.

    Its unit is the generator's; `align.object` finds scale and orientation.

    Args:
        ctx: The rule's context.
        data: The file.
        suffix: Its format, `.glb`.
        view: The view that was passed to the generator.
        made_by: Name of the generator.
        texture_px: Maximum side of the texture [px].
    """
    path = Path(ctx.scratch, f"made{suffix}")
    path.write_bytes(data)
    mesh, repair = repaired(load(path))
    ctx.log(f"{made_by}: {len(mesh.faces):,} faces; {repair}")
    if repair.open_edges:
        ctx.fail(
            f"the mesh of {made_by} cannot be closed: {repair.open_edges:,} edges are open",
            hint="another number of faces gives another mesh; or use another backend",
        )
    mesh = _standing(mesh, texture_px)
    found = explain(mesh.vertices.astype(np.float64), mesh.faces, view.mask, view.occluder)
    return Shape(
        mesh=mesh,
        hypothesis=made_by,
        hollow=_is_hollow(mesh, repair.volume_m3),
        mask_iou=found.iou,
        unseen_fraction=found.unseen_fraction,
        scores={made_by: found.iou},
    )


def _standing(mesh: Mesh, texture_px: int) -> Mesh:
    """The mesh with the centre of its base at the origin, and with a texture of the allowed size."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]], np.float32)
    return mesh.model_copy(update={"vertices": mesh.vertices - shift, "texture": _fitting(mesh.texture, texture_px)})


def _fitting(texture: Image | None, most_px: int) -> Image | None:
    if texture is None or max(texture.pixels.shape[:2]) <= most_px:
        return texture
    from PIL import Image as Pillow

    picture = Pillow.fromarray(texture.pixels)
    picture.thumbnail((most_px, most_px), Pillow.Resampling.LANCZOS)
    return Image(pixels=np.asarray(picture))


def _is_hollow(mesh: Mesh, volume: float | None) -> bool:
    if volume is None:
        return False
    empty = cavity.find(mesh).volume
    return empty > _HOLLOW * (empty + volume)
