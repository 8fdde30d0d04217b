"""simulate.steady: hold the bodies that would not stay where the photograph has them."""

from __future__ import annotations

from typing import Any, Protocol

from pydantic import PositiveFloat

from dextera_build.artifacts.scene import Scene
from dextera_build.rule import Context, rule

from .settle import SettleOptions


class SteadyOptions(SettleOptions):
    """Options of simulate.steady: those of `simulate.settle`."""

    seconds: PositiveFloat = 1.5
    """Simulated time of an attempt [s]; what `simulate.settle` finds later, it reports."""


class SteadyBackend(Protocol):
    """What a backend of simulate.steady defines."""

    def hold(self, ctx: Context, scene: Scene, common: SteadyOptions, options: Any) -> tuple[Scene, list[str]]:
        """The scene in which the free bodies rest, and what was done about the others."""
        ...


@rule(version=3)
def steady(ctx: Context[SteadyBackend], scene: Scene, *, options: SteadyOptions) -> Scene:
    """Return the scene with the bodies that would not rest held in their places, as parts of the static scene.

    One wrong shape does not spoil a scene: a fragment inside another body, or a body that tips over, stays where the
    photograph has it, with its looks and its collision geometry, and a warning names it.
    """
    result, reasons = ctx.backend.hold(ctx, scene, options, ctx.backend_options)
    for reason in reasons:
        ctx.warn(reason)
    held = len(result.held) - len(scene.held)
    ctx.metric("held", held, f"of {len(scene.bodies)}")
    free = f"{len(result.bodies)} {'body is' if len(result.bodies) == 1 else 'bodies are'} free"
    ctx.say(free + (f", {held} held" if held else "") + (", scale unknown" if result.scale == "unknown" else ""))
    return result
