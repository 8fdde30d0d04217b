"""demonstrate.teach without a simulator: nothing moves, and every episode succeeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .teach import TeachOptions

BACKEND = Backend(summary="no simulation: nothing moves, and every episode succeeds", profiles=("stub",))


def teach(
    ctx: Context,
    bundle: TaskBundle,
    teacher: Checkpoint,
    student: Checkpoint | None,
    views: Mapping[str, View],
    seeds: list[int],
    terms: tuple[TermSpec, ...],
    common: TeachOptions,
    options: Options,
) -> Iterator[tuple[Episode, float]]:
    """Motionless episodes."""
    for seed in seeds:
        yield fake_trial(bundle, seed, "policy", success=True, terms=terms), 0.0
