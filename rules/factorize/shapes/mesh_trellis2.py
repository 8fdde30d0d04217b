"""Textured meshes from the photograph alone, by TRELLIS.2 in its own environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

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
    summary="TRELLIS.2, from the photograph alone",
    packages=("manifold3d", "open3d", "pillow", "trimesh"),
    extra="twin",
    command=("{python}", "trellis2_program.py"),
    files=("cutout.py",),
    environment="venv:.envs/trellis2",
    lock="envs/trellis2.lock",
    server=True,
    gpu_gb=24.0,
    timeout_s=1800.0,
    weights=("trellis2",),
    licence="MIT; nvdiffrast and nvdiffrec have their own",
)


class Trellis2Options(Options):
    """Options of backend `trellis2` of factorize.mesh."""

    resolution: Literal["512", "1024_cascade", "1536_cascade"] = "1024_cascade"
    """Voxel resolution, the pipeline's `pipeline_type`."""
    faces: int = Field(40_000, ge=1000, le=1_000_000)
    """Number of faces that the mesh is reduced to."""
    texture_px: int = Field(1024, ge=256, le=4096)
    """Side of the baked texture [px]."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def complete(
    ctx: Context,
    view: ObjectView,
    measured: Measurements[Seen],
    common: MeshOptions,
    options: Trellis2Options,
) -> Shape:
    """The mesh that TRELLIS.2 (Xiang et al., 2025) generates from the cut-out object. No measurement is used."""
    made = ctx.outside("complete", File, image=view.rgb, mask=view.mask)
    return shape_of(ctx, made.data, ".glb", view, "trellis2", common.texture_px)
