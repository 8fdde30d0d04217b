"""simulate.usd without OpenUSD: an empty stage with one named prim per object."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .usd import UsdOptions

BACKEND = Backend(summary="a stage of empty prims", profiles=("stub",))


def write(
    ctx: Context, described: SceneDescription, held: tuple[str, ...], common: UsdOptions, options: Options
) -> Folder:
    """`scene.usda` with `/World/<object>`, in whichever form is asked for."""
    robots = [each.prefix.removesuffix("/") for each in described.attachments]
    prims = "".join(f'    def Xform "{name}" {{}}\n' for name in (*described.bodies, *robots))
    head = '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
    return Folder(files={"scene.usda": f'{head}\ndef Xform "World"\n{{\n{prims}}}\n'.encode()})


def problems(
    ctx: Context, folder: Folder, described: SceneDescription, held: tuple[str, ...], options: Options
) -> list[str]:
    """Return no problems."""
    return []
