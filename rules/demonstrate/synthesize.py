"""demonstrate.synthesize: many episodes from few demonstrations (Eq. 4)."""

from __future__ import annotations

import math
from typing import Any, Protocol

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes, Shard
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy.added import listed
from dextera_build.rule import Context, Options, Tolerance, rule


class SynthesizeOptions(Options):
    """Options of demonstrate.synthesize."""

    noise_position_m: NonNegativeFloat = 0.003
    """Standard deviation of the noise on the palm's position, per axis [m]."""
    noise_rotation_deg: NonNegativeFloat = 0.6
    """Standard deviation of the noise on the palm's rotation vector, per axis [deg]."""
    noise_finger_deg: NonNegativeFloat = 1.0
    """Standard deviation of the noise on every finger joint [deg]."""
    noise_correlation: float = Field(0.99, ge=0.0, lt=1.0)
    """Correlation of the noise in consecutive control steps, 0..1."""
    noise_in_contact: bool = False
    """Whether to add noise in segments with intended contact, too."""
    speed_m_s: PositiveFloat = 0.35
    """Speed of interpolated motion [m/s]."""
    turn_deg_s: PositiveFloat = 70.0
    """Angular speed of interpolated motion [deg/s]."""
    nearest: PositiveInt = 3
    """Number of demonstrations with the most similar object pose from which the source is drawn."""
    recover: float = Field(0.0, ge=0.0, le=1.0)
    """Share of the episodes in which the hand once leaves its path, and the label leads it back, 0..1."""
    recover_position_m: NonNegativeFloat = 0.02
    """Standard deviation of the palm's displacement from its path, per axis [m]."""
    recover_rotation_deg: NonNegativeFloat = 5.0
    """Standard deviation of the palm's rotation vector from its path, per axis [deg]."""
    soften: bool = False
    """Whether fingers that press with their whole effort press less in any case, so that together they cannot push
    into the thumb; otherwise only if a joint was faster than its limit in a demonstration."""
    lag_m: PositiveFloat = 0.02
    """Episodes in which joint limits keep the palm farther than this from its command are discarded [m]."""
    press_n: NonNegativeFloat = 2.0
    """Episodes in which two bodies that should not touch press each other with more than this are discarded [N]."""
    displaced_m: PositiveFloat = 0.005
    """Episodes in which a movable body without a part in the task is displaced by more are discarded [m]."""
    depth_m: PositiveFloat = 0.002
    """Episodes in which the robot or an object penetrates anything by more than this are discarded [m]."""
    grip_m: PositiveFloat = 0.006
    """The same where a hand should touch the object, because the pads of fingers are soft [m]."""
    speed: PositiveFloat = 1.1
    """Episodes in which a joint moves faster than this multiple of its limit are discarded."""
    acceleration: PositiveFloat = 1.0
    """Paths are retimed so that no joint of an arm is accelerated more than this multiple of its limit, which the
    robot's recipe states, and episodes in which one is all the same are discarded."""
    hold_s: NonNegativeFloat = 0.5
    """Episodes whose success does not last for this time are discarded, if the task demands less [s]."""
    tries: PositiveInt = 6
    """Maximum attempts per episode, after which fewer episodes are returned."""


class SynthesizeBackend(Protocol):
    """Interface of a backend of demonstrate.synthesize."""

    def synthesize(
        self,
        ctx: Context,
        bundle: TaskBundle,
        sources: Episodes,
        shard: Shard,
        terms: tuple[TermSpec, ...],
        common: SynthesizeOptions,
        options: Any,
    ) -> Episodes:
        """Attempt episodes until the shard is full, or the attempts are used up."""
        ...


# Contacts amplify rounding differences, and an attempt may end differently on another processor.
@rule(
    version=2,
    tolerance=Tolerance({"items": math.inf, "failures": math.inf, "attempts": math.inf}, metrics={"yield": 0.2}),
    runs={"bundle": "primitive", "terms": ""},
)
def synthesize(
    ctx: Context[SynthesizeBackend],
    bundle: TaskBundle,
    sources: Episodes,
    shard: Shard,
    terms: Collection[TermSpec] | None = None,
    *,
    options: SynthesizeOptions,
) -> Episodes:
    """Return the shard's episodes in the robot's base frame [m, rad], and discarded attempts with their reasons.

    Every attempt has its own start and noise, drawn from a seed derived from (data set, attempt). The label is the
    clean target; the executed command is stored with it. Every run of a limb is adapted from the demonstration whose
    frame was nearest at that time, limbs that a segment names together share one transform, and the result is slowed
    to the speeds and accelerations of the arms. If too few attempts succeed, there are fewer episodes.

    Raises:
        RuleError: There are no demonstrations, they show another task, or no attempt succeeded.
    """
    ctx.check(bool(sources.items), "no demonstrations were given", hint="look at `dxb log` of the operator")
    ctx.check(
        sources.task == bundle.task.name,
        f"the demonstrations show `{sources.task}`, but the task is `{bundle.task.name}`",
        hint="give both the same task bundle",
    )
    found: Episodes = ctx.backend.synthesize(ctx, bundle, sources, shard, listed(terms), options, ctx.backend_options)
    done = len(found.items)
    ctx.check(
        done > 0,
        f"only {done} of {shard.count} episodes of `{bundle.task.name}` came out",
        attempts=found.attempts,
        reasons=spelled(found.reasons, most=5),
        hint="add demonstrations, lower the noise or raise `tries`",
    )
    ctx.metric("yield", done / max(1, found.attempts))
    ctx.say(f"{done} episodes from {found.attempts} attempts ({100 * done / max(1, found.attempts):.0f} %)")
    if done < shard.count:
        ctx.warn(f"only {done} of {shard.count} episodes came out: {spelled(found.reasons, most=5)}")
    for reason, count in found.reasons.items():
        ctx.log(f"{count} x {reason}")
    return found
