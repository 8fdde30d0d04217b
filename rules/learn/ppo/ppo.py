"""learn.ppo: reinforcement learning in the task's own simulation (Schulman et al. 2017, arXiv 1707.06347)."""

from __future__ import annotations

import math
from typing import Any, Protocol

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.policy import Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import listing
from dextera_build.learning import curve_picture
from dextera_build.policy.added import listed
from dextera_build.rule import ROUNDING, Context, Tolerance, rule

from .ppo_options import PpoOptions
from .practised import Practised
from .reinforcement import contract_of, limbs_of


class PpoBackend(Protocol):
    """Interface of a backend of learn.ppo."""

    def nearest(self, ctx: Context, bundle: TaskBundle, options: Any) -> str:
        """The limb whose palm is nearest to the task's object, as the scripted operator prefers it."""
        ...

    def heading(self, ctx: Context, bundle: TaskBundle, options: Any) -> float | None:
        """Initial push direction of the task's link about the vertical in the base [rad]; None for a lift."""
        ...

    def practise(
        self,
        ctx: Context,
        bundle: TaskBundle,
        contract: PolicyContract,
        terms: tuple[TermSpec, ...],
        common: PpoOptions,
        options: Any,
    ) -> Practised:
        """Train, or resume an interrupted training."""
        ...


# As in learn.act; rewards are of other episodes, too.
@rule(
    version=1,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=Tolerance({"": ROUNDING, "weights": math.inf, "curve": 3.0}, metrics={"success while exploring": 0.4}),
    runs={"bundle": "primitive", "terms": ""},
)
def ppo(
    ctx: Context[PpoBackend], bundle: TaskBundle, terms: Collection[TermSpec] | None = None, *, options: PpoOptions
) -> Checkpoint:
    """Return a policy trained by PPO on deployable observations; only its critic is privileged, unless it is a teacher.

    An interrupted training resumes and ends with the same weights.
    """
    limbs = limbs_of(bundle, lambda: ctx.backend.nearest(ctx, bundle, ctx.backend_options))
    _check(ctx, bundle, limbs, options)
    added = listed(terms)
    contract = contract_of(bundle, limbs, options, ctx.backend.heading(ctx, bundle, ctx.backend_options), added)
    ctx.check(int(contract.settings["decisions"]) > 0, "the robot has no joints in `groups`", groups=options.groups)
    practised = ctx.backend.practise(ctx, bundle, contract, added, options, ctx.backend_options)
    ctx.check(len(practised.steps) == len(practised.reward) > 0, "the training has no reward curve")
    _report(ctx, practised)
    return Checkpoint(
        weights=practised.weights,
        contract=contract,
        steps=practised.steps,
        curve=practised.reward,
        curve_name="mean reward of an episode",
    )


def _check(ctx: Context, bundle: TaskBundle, limbs: tuple[str, ...], options: PpoOptions) -> None:
    for limb in (bundle.robot.limbs[name] for name in limbs):
        if options.control == "palm" and not limb.palm:
            ctx.fail("the robot has no frame `palm` that could be steered", hint="set `control: joints`")
        if options.grip is not None and options.grip not in limb.grips:
            ctx.fail(f"the robot has no grip `{options.grip}`", grips=listing(limb.grips) or "none")


def _report(ctx: Context, practised: Practised) -> None:
    steps, last = practised.steps, int(practised.steps[-1])
    for curve, what in ((practised.reward, "mean reward of an episode"), (practised.success, "share of successes")):
        ctx.preview(
            curve_picture.draw({what: (steps, curve)}, f"{what}, exploring", logarithmic=False),
            f"{what} over {last:,} decisions",
        )
    success = float(practised.success[-1])
    ctx.metric("success while exploring", success)
    within = "" if practised.share == 1.0 else f" within {100 * practised.share:.0f} % of the ranges of starts"
    ctx.say(
        f"{last:,} decisions, {practised.episodes:,} episodes, {100 * success:.0f} % success while exploring{within}"
    )
