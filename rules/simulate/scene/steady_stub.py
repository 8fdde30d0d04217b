"""simulate.steady without a simulator: every body is free."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .steady import SteadyOptions

BACKEND = Backend(summary="no simulation: every body is free", profiles=("stub",))


def hold(ctx: Context, scene: Scene, common: SteadyOptions, options: Options) -> tuple[Scene, list[str]]:
    """Return the scene unchanged."""
    return scene, []
