"""simulate.usd with OpenUSD, checked by all of its validators and against MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.usd import check as usd_check
from dextera_build.sim.usd import packing, writer

if TYPE_CHECKING:
    from .usd import UsdOptions

BACKEND = Backend(
    summary="OpenUSD with UsdPhysics, validated",
    profiles=("cpu",),
    packages=("mujoco", "scipy", "usd-core"),
    extra="twin",
)


def write(
    ctx: Context, described: SceneDescription, held: tuple[str, ...], common: UsdOptions, options: Options
) -> Folder:
    """The stage and its textures; see `dextera_build.sim.usd.writer`."""
    return packing.packed(writer.write(described, held, common.white_nits), common.form, ctx.scratch)


def problems(
    ctx: Context, folder: Folder, described: SceneDescription, held: tuple[str, ...], options: Options
) -> list[str]:
    """Errors and warnings of the validators, or else differences from the MJCF of the scene, one line each."""
    invalid = usd_check.problems(folder, ctx.scratch)
    return invalid or usd_check.unequal(folder, described, held, ctx.scratch)
