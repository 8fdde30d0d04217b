"""Meshes from the photograph alone, by SAM 3D Objects in its own environment."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field, NonNegativeInt

from dextera_build.artifacts.base import File
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from .generated import shape_of

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="SAM 3D Objects, from the photograph alone",
    packages=("manifold3d", "open3d", "pillow", "trimesh"),
    extra="twin",
    command=("{python}", "sam3d_objects_program.py"),
    files=("cutout.py",),
    environment="venv:.envs/sam3d_objects",
    lock="envs/sam3d_objects.lock",
    server=True,
    gpu_gb=32.0,
    timeout_s=1800.0,
    weights=("sam3d_objects", "moge_vitl"),
    licence="SAM License (SAM 3D Objects), MIT (MoGe)",
)


class Sam3dObjectsOptions(Options):
    """Options of backend `sam3d_objects` of factorize.mesh."""

    faces: int = Field(40_000, ge=1000, le=80_000)
    """Number of faces that the mesh is reduced to; each has its own patch of the texture."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def complete(
    ctx: Context,
    view: ObjectView,
    measured: Measurements[Seen],
    common: MeshOptions,
    options: Sam3dObjectsOptions,
) -> Shape:
    """The mesh that SAM 3D Objects (Meta, 2025) generates from the masked picture. No measurement is used.

    The model conditions on points that MoGe estimates from the picture.
    """
    made = ctx.outside("complete", File, image=view.rgb, mask=view.mask)
    return shape_of(ctx, made.data, ".ply", view, "sam3d_objects", common.texture_px)
