"""demonstrate.teach: a teacher says at every step of a student what it would have done (DAgger)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import listed
from dextera_build.policy.cameras import given
from dextera_build.policy.layout import gathered
from dextera_build.rule import Context, Options, Tolerance, rule
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import wilson


class TeachOptions(Options):
    """Options of demonstrate.teach."""

    episodes: PositiveInt = 50
    """Number of episodes."""
    first: NonNegativeInt = 0
    """Index of the first one; rounds that will be gathered need different ones."""
    seed: NonNegativeInt = 0
    """Seed of the starts, together with the index."""
    led: float = Field(0.0, ge=0.0, le=1.0)
    """Probability that the teacher acts in a control period instead of the student, 0..1."""
    position_m: NonNegativeFloat = 0.002
    """Standard deviation of the object positions that the student sees, per axis [m]."""
    rotation_deg: NonNegativeFloat = 1.0
    """Standard deviation of the rotations that it sees, about each axis [deg]."""
    joint_deg: NonNegativeFloat = 0.0
    """Standard deviation of the joint positions that it sees [deg]."""
    delay_s: NonNegativeFloat = 0.0
    """Age of the poses that it sees [s]."""
    loss: float = Field(0.05, ge=0.0, lt=1.0)
    """Probability that a measurement of poses is lost, so that it sees the previous one, 0..1."""


class TeachBackend(Protocol):
    """Interface of a backend of demonstrate.teach."""

    def teach(
        self,
        ctx: Context,
        bundle: TaskBundle,
        teacher: Checkpoint,
        student: Checkpoint | None,
        views: Mapping[str, View],
        seeds: list[int],
        terms: tuple[TermSpec, ...],
        common: TeachOptions,
        options: Any,
    ) -> Iterator[tuple[Episode, float]]:
        """Each seed's episode, and the mean difference of the targets of teacher and student [rad]."""
        ...


# Contacts amplify rounding differences, and an attempt may end differently on another processor.
@rule(
    version=1,
    packages=("numpy",),
    memory_gb=2.0,
    tolerance=Tolerance({"items": math.inf}, metrics={"success": 20.0, "apart": math.inf}),
    runs={"bundle": "primitive", "teacher": "policy", "student": "policy", "terms": ""},
)
def teach(
    ctx: Context[TeachBackend],
    bundle: TaskBundle,
    teacher: Checkpoint,
    student: Checkpoint | None = None,
    view: View | None = None,
    views: Collection[View] | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: TeachOptions,
) -> Episodes:
    """Return episodes in which a student acts and every label is its teacher's, in the base frame [m, rad].

    One round of DAgger (Ross et al. 2011, arXiv 1011.0686): train the next student on the episodes of all rounds,
    which `demonstrate.gather` merges. Without a student the teacher acts. The teacher sees the true state, and what
    only a simulator knows if it was trained so (`learn.ppo` with `privileged`); recorded observations are those of the
    student, with errors and losses as a tracker's. Every episode is kept, also those that fail. A student that sees
    pictures needs `view`, or `views` of several cameras.
    """
    added, cameras = listed(terms), given(view, views)
    if student is not None:
        contracts.check(student.contract, bundle, views=cameras, terms=added)
    seeds = [seed_of("lesson", options.seed, options.first + number) for number in range(options.episodes)]
    items, apart = dict[str, Episode](), list[float]()
    made = ctx.backend.teach(ctx, bundle, teacher, student, cameras, seeds, added, options, ctx.backend_options)
    for number, (episode, difference) in enumerate(made):
        items[f"{options.first + number:05d}"] = episode
        apart.append(difference)
        ctx.progress(number + 1, options.episodes, f"{sum(each.success for each in items.values())} succeeded")
    done, count = sum(each.success for each in items.values()), len(items)
    low, high = wilson(done, count)
    ctx.metric("success", 100 * done / count, "%")
    ctx.metric("apart", 1000 * float(np.mean(apart)), "mrad")
    ctx.say(
        f"{'the teacher' if student is None else 'the student'} succeeded in {done} of {count} episodes"
        f" ({100 * low:.0f}-{100 * high:.0f} %)"
        + ("" if student is None else f", {1000 * float(np.mean(apart)):.0f} mrad from its teacher")
    )
    return gathered(bundle, items, {}, count, added)
