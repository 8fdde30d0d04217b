"""simulate.perturbed: a twin's task in a perturbed copy of the twin, for tasks without a reference world."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Context, Options, rule


class PerturbedOptions(Options):
    """Options of simulate.perturbed: differences of the copy from the twin."""

    seed: NonNegativeInt = 0
    """Seed of all draws."""
    size_sigma: NonNegativeFloat = 0.02
    """Standard deviation of the logarithm of an object's scale: along each axis, or of all if the object has joints."""
    sizes: dict[str, tuple[PositiveFloat, PositiveFloat, PositiveFloat]] = Field(default_factory=dict)
    """Body -> scale factors along x, y, z of its frame, instead of drawn ones."""
    dynamics: NonNegativeFloat = 1.0
    """Fraction of the twin's own intervals of mass and friction to draw from."""
    hinge_sigma: NonNegativeFloat = 0.15
    """Standard deviation of the logarithm of the factor on a hinge's friction."""
    centre_m: NonNegativeFloat = 0.003
    """Standard deviation of each coordinate of the centre of mass [m]."""
    contact_sigma: NonNegativeFloat = 0.3
    """Standard deviation of the logarithm of the factor on the contacts' natural frequency."""
    gain_spread: float = Field(0.08, ge=0.0, lt=1.0)
    """Half range of the factors on stiffness and damping of every joint's controller."""
    arm_friction: NonNegativeFloat = 0.01
    """Dry friction of an arm joint, as a fraction of its maximum torque."""
    hand_friction: NonNegativeFloat = 0.03
    """Dry friction of a hand joint, as a fraction of its maximum torque."""
    skin_spread: float = Field(0.15, ge=0.0, lt=1.0)
    """Half range of the factor on the friction of gripping parts such as fingertips."""
    timestep_s: PositiveFloat = 0.001
    """Step of the simulation [s]."""
    latency_s: NonNegativeFloat = 0.01
    """Time from a command to its effect [s]."""


class PerturbedBackend(Protocol):
    """Interface of a backend of simulate.perturbed."""

    def build(
        self, ctx: Context, bundle: TaskBundle, common: PerturbedOptions, options: Any
    ) -> tuple[TaskBundle, dict[str, tuple[float, float, float]]]:
        """Build the perturbed task and the scale factors of every object."""
        ...

    def portraits(self, ctx: Context, bundle: TaskBundle, options: Any) -> list[tuple[str, np.ndarray]]:
        """Captions and pictures (H, W, 3) uint8."""
        ...


@rule(version=1, packages=("numpy",))
def perturbed(
    ctx: Context[PerturbedBackend], bundle: TaskBundle, *, options: PerturbedOptions | None = None
) -> TaskBundle:
    """Return the task in a perturbed copy of its twin: other sizes, masses, friction, gains and time step.

    Masses and friction are drawn from the twin's own intervals, everything else according to the options. Names,
    frames, joints, goal and success are unchanged, as are photographed poses and points, which are estimates of the
    twin.

    The backend offers `build(bundle, options) -> (TaskBundle, body -> scale factors)` and `portraits(bundle)`.
    """
    options = options or PerturbedOptions()
    ctx.check(
        bundle.kind == "twin",
        f"only the task in a twin is disturbed, but this one is `{bundle.kind}`",
        hint="give the bundle of `simulate.task`",
    )
    built, sizes = ctx.backend.build(ctx, bundle, options, ctx.backend_options)
    ctx.check(list(built.objects) == list(bundle.objects), "the disturbed twin lost an object of the task")
    largest = max((abs(factor - 1.0) for factors in sizes.values() for factor in factors), default=0.0)
    ctx.metric("largest change of size", 100 * largest, "%")
    ctx.say(f"{len(sizes)} objects disturbed, sizes by up to {100 * largest:.1f} %; simulated")
    for caption, picture in ctx.backend.portraits(ctx, built, ctx.backend_options):
        ctx.preview(picture, caption)
    result: TaskBundle = built
    return result
