"""reference.task: a twin's task in the reference world in which the twin was photographed."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule


class TaskOptions(Options):
    """Options of reference.task: dynamics of the real robot, unknown to the twin."""

    seed: NonNegativeInt = 0
    """Seed of the draws."""
    gain_spread: float = Field(0.08, ge=0.0, lt=1.0)
    """Half range of the factors on stiffness and damping of every joint's controller."""
    arm_friction: NonNegativeFloat = 0.01
    """Dry friction of an arm joint, as a fraction of its maximum torque."""
    hand_friction: NonNegativeFloat = 0.03
    """Dry friction of a hand joint, as a fraction of its maximum torque."""
    skin_spread: float = Field(0.15, ge=0.0, lt=1.0)
    """Half range of the factor on the friction of gripping parts such as fingertips."""
    contact_rate_rad_s: PositiveFloat = 200.0
    """Natural frequency of contacts; the twin's is 100 [rad/s]."""
    timestep_s: PositiveFloat = 0.001
    """Step of the simulation [s]."""
    latency_s: NonNegativeFloat = 0.01
    """Time from a command to its effect [s]."""
    match_m: PositiveFloat = 0.05
    """Maximum surface distance between an asset and its true object [m]."""


class TaskBackend(Protocol):
    """Interface of a backend of reference.task."""

    def build(self, ctx: Context, bundle: TaskBundle, world: World, common: TaskOptions, options: Any) -> TaskBundle:
        """Build the task in the reference world."""
        ...

    def portraits(self, ctx: Context, bundle: TaskBundle, options: Any) -> list[tuple[str, np.ndarray]]:
        """Captions and pictures (H, W, 3) uint8."""
        ...


# The files hold numbers as text, and text has no difference to bound.
@rule(
    version=1, packages=("numpy", "scipy", "manifold3d"), tolerance=Tolerance({"": ROUNDING, "model.files": math.inf})
)
def task(
    ctx: Context[TaskBackend],
    bundle: TaskBundle,
    world: World,
    robot: RobotModel,
    *,
    options: TaskOptions | None = None,
) -> TaskBundle:
    """Return the task in its reference world: true shapes, masses, friction and hinges, in the twin's world frame [m].

    A simulated substitute for hardware. Names, frames, joints, goal and success are the twin's, as if its assets were
    tracked: a body's frame coincides with the twin's in the photograph and moves with the true object. The robot's base
    aligns both worlds.

    The backend offers `build(bundle, world, options) -> TaskBundle` and `portraits(bundle)`: captions and pixels.
    """
    options = options or TaskOptions()
    ctx.check(
        bundle.kind == "twin",
        f"a reference world is made from the task in a twin, but this one is `{bundle.kind}`",
        hint="give the bundle of `simulate.task`",
    )
    ctx.check(
        bundle.robot == robot,
        "the task's robot is not the robot of the reference world",
        hint="give both rules the same `robot`",
    )
    built: TaskBundle = ctx.backend.build(ctx, bundle, world, options, ctx.backend_options)
    ctx.check(list(built.objects) == list(bundle.objects), "the reference world lost an object of the task")
    off = [
        abs(true - seen)
        for name, thing in built.objects.items()
        for true, seen in zip(thing.positions, bundle.objects[name].positions, strict=True)
    ]
    if off:
        ctx.metric("largest joint error of the twin", max(off), "rad")
    extra = len(world.objects) - len(built.objects)
    others = f", {extra} that the twin does not know" if extra else ""
    ctx.say(f"{len(built.objects)} objects tracked{others}; step {1000 * options.timestep_s:g} ms; simulated")
    for caption, picture in (
        *ctx.backend.portraits(ctx, bundle, ctx.backend_options),
        *ctx.backend.portraits(ctx, built, ctx.backend_options),
    ):
        ctx.preview(picture, caption)
    return built
