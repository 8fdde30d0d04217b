"""Textured meshes from the photograph alone, by Hunyuan3D 2.1 in its own environment."""

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
    summary="Hunyuan3D 2.1, from the photograph alone",
    packages=("manifold3d", "open3d", "pillow", "trimesh"),
    extra="twin",
    command=("{python}", "hunyuan3d_2_1_program.py"),
    files=("cutout.py",),
    environment="venv:.envs/hunyuan3d_2_1",
    lock="envs/hunyuan3d_2_1.lock",
    server=True,
    gpu_gb=29.0,
    timeout_s=1800.0,
    weights=("hunyuan3d_2_1", "dinov2_giant"),
    licence="Tencent Hunyuan 3D 2.1 Community License, Apache-2.0 (DINOv2)",
)


class Hunyuan3d21Options(Options):
    """Options of backend `hunyuan3d_2_1` of factorize.mesh."""

    steps: int = Field(25, ge=5, le=100)
    """Sampling steps for the shape."""
    views: int = Field(4, ge=1, le=9)
    """Number of views for the texture; more views need more memory."""
    view_px: int = Field(512, ge=512, le=768)
    """Side of a view [px]."""
    seed: NonNegativeInt = 0
    """Seed of the sampling."""


def complete(
    ctx: Context,
    view: ObjectView,
    measured: Measurements[Seen],
    common: MeshOptions,
    options: Hunyuan3d21Options,
) -> Shape:
    """The mesh that Hunyuan3D 2.1 (Tencent, 2025) generates from the cut-out object. No measurement is used."""
    made = ctx.outside("complete", File, image=view.rgb, mask=view.mask)
    return shape_of(ctx, made.data, ".glb", view, "hunyuan3d_2_1", common.texture_px)
