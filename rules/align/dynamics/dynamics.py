"""align.dynamics: masses, friction and controllers from recordings of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from pydantic import Field, PositiveFloat, PositiveInt

from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.contract import check_data
from dextera_build.rule import Context, Options, rule


class DynamicsOptions(Options):
    """Options of align.dynamics."""

    runs: PositiveInt = 20
    """Maximum number of recordings to use, evenly chosen."""
    rounds: PositiveInt = 5
    """Gauss-Newton steps."""
    narrower: float = Field(0.5, gt=0.0, lt=1.0)
    """A quantity is identified if its standard deviation is at most this fraction of what the twin states."""
    mass_kg: PositiveFloat | None = None
    """Mass of the task's object from scales, with which pushes tell its friction [kg]; None: not weighed."""
    mass_sigma: PositiveFloat = 0.02
    """Standard deviation of the logarithm of `mass_kg`."""


class DynamicsBackend(Protocol):
    """Interface of a backend of align.dynamics."""

    def estimate(
        self, ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], common: DynamicsOptions, options: Any
    ) -> DynamicsEstimate:
        """Estimate everything from at most `common.runs` of these recordings."""
        ...


@rule(version=1, packages=("numpy",), runs={"bundle": "primitive"})
def dynamics(
    ctx: Context[DynamicsBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    *,
    options: DynamicsOptions | None = None,
) -> DynamicsEstimate:
    """Return mass [kg] and friction of the task's object, stiffness, lag [s], friction and latency [s] of the arms.

    The arms of the twin are simulated with the commands that were sent, without contacts; where the hand carries the
    object or slides it along, its weight and its friction act on the palm. All quantities are fitted at once to the
    measured joints by nonlinear least squares with the twin's own uncertainty as prior (output error method; Ljung
    1999, System Identification, 7). What is narrowed too little is not identified: it keeps the twin's value, with the
    reason. Episodes may have failed.

    Raises:
        RuleError: The recordings are of another task or robot, of the twin itself, or hold no usable part.
    """
    options = options or DynamicsOptions()
    ctx.check(
        bundle.kind == "twin",
        f"dynamics are estimated for a twin, but this task is in a {bundle.kind} world",
        hint="give the bundle of `simulate.task`",
    )
    ctx.check(
        episodes.world != "twin",
        "these episodes were simulated in the twin, which cannot learn from itself",
        hint="give those of `demonstrate.recorded` or `reference.episodes`",
    )
    check_data(bundle, episodes)
    every = [episode for _, episode in episodes.in_order()]
    every += [episode for _, episode in sorted(episodes.failures.items())]
    found: DynamicsEstimate = ctx.backend.estimate(ctx, bundle, every, options, ctx.backend_options)
    _report(ctx, found)
    return found


def _report(ctx: Context, found: DynamicsEstimate) -> None:
    for name, each in found.estimates.items():
        ctx.log(
            f"{name}: not identifiable from these recordings, {each.why}; it stays at {each.value:.4g}"
            if each.why
            else f"{name}: {each.value:.4g} ± {each.sigma:.2g}, before {each.prior:.4g} ± {each.prior_sigma:.2g}"
        )
    for name, thing in found.objects.items():
        for field, each in thing:
            if each.why:
                ctx.warn(f"{field} of {name} is not identifiable from these recordings: {each.why}")
            else:
                ctx.metric(f"{field} of {name}", each.value)
    identified = sum(each.identified for each in found.estimates.values())
    ctx.metric("residual", 1000 * found.residual, "mrad")
    ctx.say(
        f"{identified} of {len(found.estimates)} quantities identified from {found.runs} recordings, "
        + ", ".join(f"{count} {name}" for name, count in found.periods.items())
        + " periods"
    )
