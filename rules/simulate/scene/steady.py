"""simulate.steady: fix bodies that would not rest at their photographed poses."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import PositiveFloat

from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.rule import Context, rule

from .settle import SettleOptions


class SteadyOptions(SettleOptions):
    """Options of simulate.steady: those of `simulate.settle`."""

    seconds: PositiveFloat = 1.5
    """Simulated time of an attempt [s]; `simulate.settle` reports later motion."""


class SteadyBackend(Protocol):
    """Interface of a backend of simulate.steady."""

    def hold(self, ctx: Context, scene: Scene, common: SteadyOptions, options: Any) -> tuple[Scene, list[str]]:
        """The scene in which all free bodies rest, and the report on the fixed ones."""
        ...


@rule(version=3)
def steady(ctx: Context[SteadyBackend], scene: Scene, *, options: SteadyOptions) -> Scene:
    """Return the scene with bodies that would not rest fixed at their poses, as parts of the static scene.

    One wrong shape does not invalidate a scene: a fragment inside another body, or a body that tips over, is fixed at
    its photographed pose with its visual and collision geometry, and a warning names it.
    """
    result, reasons = ctx.backend.hold(ctx, scene, options, ctx.backend_options)
    for reason in reasons:
        ctx.warn(reason)
    held = len(result.held) - len(scene.held)
    ctx.metric("held", held, f"of {len(scene.bodies)}")
    free = f"{len(result.bodies)} {'body is' if len(result.bodies) == 1 else 'bodies are'} free"
    ctx.say(free + (f", {held} held" if held else "") + (", scale unknown" if result.scale == "unknown" else ""))
    return result
