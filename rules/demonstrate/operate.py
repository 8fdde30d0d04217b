"""demonstrate.operate: an operator demonstrates a task several times."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy.added import listed
from dextera_build.rule import Context, Options, Tolerance, rule
from dextera_build.sim.experts import workplace
from dextera_build.sim.experts.workplace import Other
from dextera_build.statistics import wilson


class OperateOptions(Options):
    """Options of demonstrate.operate."""

    episodes: PositiveInt = 10
    """Number of demonstrations; not for a recording."""
    seed: NonNegativeInt = 0
    """Seed of the starts."""
    tries: PositiveInt = 4
    """Maximum attempts per demonstration."""
    attempts: PositiveInt | None = None
    """Fixed number of attempts, instead of `episodes` and `tries`: for success rates, including 0. Of a
    recording, the first takes."""
    good: PositiveInt = 12
    """Number of candidate plans that succeed in two trials, at which the scripted operator tries no more. Fewer are
    found sooner, and succeed at fewer starts."""
    lag_m: PositiveFloat = 0.02
    """Episodes in which joint limits keep the palm farther than this from its command are discarded [m]."""
    accept_other: tuple[Other, ...] = ()
    """What may be another one than the recording was made with: `task`, `robot`. So hands that were recorded with one
    robot are retargeted to another, which their operator did not see."""
    press_n: NonNegativeFloat = 2.0
    """Episodes with an unintended contact above this force are discarded [N]."""

    def most(self) -> tuple[int, int]:
        """Number of successes, and number of attempts, after which to stop."""
        if self.attempts is not None:
            return self.attempts + 1, self.attempts
        return self.episodes, self.tries * self.episodes


class OperateBackend(Protocol):
    """Interface of a backend of demonstrate.operate."""

    def operate(
        self,
        ctx: Context,
        bundle: TaskBundle,
        terms: tuple[TermSpec, ...],
        recording: HandStream | None,
        common: OperateOptions,
        options: Any,
    ) -> Episodes:
        """Attempt demonstrations until enough succeed or the attempts are used up; of a recording every take."""
        ...

    def strips(
        self, ctx: Context, bundle: TaskBundle, episodes: Episodes, options: Any
    ) -> list[tuple[str, np.ndarray]]:
        """Captions and film strips (H, W, 3) uint8."""
        ...


# Contacts amplify rounding differences, and an attempt may end differently on another processor.
@rule(
    version=2,
    tolerance=Tolerance({"items": math.inf, "failures": math.inf, "attempts": math.inf}, metrics={"success": 20.0}),
    runs={"bundle": ("primitive", "script"), "terms": ""},
)
def operate(
    ctx: Context[OperateBackend],
    bundle: TaskBundle,
    terms: Collection[TermSpec] | None = None,
    recording: HandStream | None = None,
    *,
    options: OperateOptions,
) -> Episodes:
    """Return demonstrations from drawn starts, in the robot's base frame [m, rad], and failed attempts with reasons.

    A scripted operator plans only from the shape of the task's assets and the embodiment's data. Backend `hands`
    follows a recording of hands: it attempts every take once, from the start of the take's seed or else from a drawn
    one, and at least one must succeed. The backend offers `operate(bundle, terms, recording, options) -> Episodes` and
    `strips(bundle, episodes) -> list of (caption, pixels)`.

    Raises:
        RuleError: Too few attempts succeed, or the operator finds no plan for the task; not with option `attempts`. The
            hands of the recording do not fit the robot or were recorded with another task or robot, or the backend
            needs a recording or follows none.
    """
    if recording is not None and (doubt := workplace.check(recording, bundle, options.accept_other)):
        ctx.warn(doubt)
    shown: Episodes = ctx.backend.operate(ctx, bundle, listed(terms), recording, options, ctx.backend_options)
    reasons = spelled(shown.reasons, most=5)
    done = len(shown.items)
    enough = options.episodes if recording is None else 1
    ctx.check(
        options.attempts is not None or done >= enough,
        f"the operator showed `{bundle.task.name}` {done} times of {enough}",
        attempts=shown.attempts,
        reasons=reasons,
        hint="make the ranges of `reset` smaller, or move the robot's base"
        if recording is None
        else f"see the failures with `attempts: {shown.attempts}`, and record the task again",
    )
    low, high = wilson(done, shown.attempts)
    ctx.metric("success", 100 * done / shown.attempts, "%")
    source = "" if recording is None else f" of hands from {recording.device}"
    ctx.say(f"{done} of {shown.attempts} attempts{source} ({100 * low:.0f}-{100 * high:.0f} %) {reasons}".rstrip())
    for caption, picture in ctx.backend.strips(ctx, bundle, shown, ctx.backend_options):
        ctx.preview(picture, caption)
    return shown
