"""simulate.usd with OpenUSD, checked by all of its validators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.scene import Background
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.usd import check as usd_check
from dextera_build.sim.usd import writer

BACKEND = Backend(
    summary="OpenUSD with UsdPhysics, validated",
    profiles=("cpu",),
    packages=("scipy", "usd-core"),
    extra="twin",
)


def write(
    ctx: Context,
    assets: Mapping[str, Asset],
    background: Background,
    camera: Camera,
    world_from_camera: np.ndarray,
    held: tuple[str, ...],
    options: Options,
) -> Folder:
    """The stage and its textures; see `dextera_build.sim.usd.writer`."""
    return writer.scene(assets, background, camera, world_from_camera, held)


def problems(ctx: Context, folder: Folder, options: Options) -> list[str]:
    """Errors and warnings of the validators, one line each."""
    return usd_check.problems(folder, ctx.scratch)
