"""simulate.usd without OpenUSD: an empty stage with one named prim per object."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.scene import Background
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import names

BACKEND = Backend(summary="a stage of empty prims", profiles=("stub",))


def write(
    ctx: Context,
    assets: Mapping[str, Asset],
    background: Background,
    camera: Camera,
    world_from_camera: np.ndarray,
    held: tuple[str, ...],
    options: Options,
) -> Folder:
    """`scene.usda` with `/World/<object>`."""
    prims = "".join(f'    def Xform "{name}" {{}}\n' for name in names.body_names(assets).values())
    head = '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
    return Folder(files={"scene.usda": f'{head}\ndef Xform "World"\n{{\n{prims}}}\n'.encode()})


def problems(ctx: Context, folder: Folder, options: Options) -> list[str]:
    """Return no problems."""
    return []
