"""evaluate.early without simulator and network: later snapshots succeed more often."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .early import Case

BACKEND = Backend(summary="no simulation: later snapshots succeed more often", profiles=("stub",))


def attempts(
    ctx: Context,
    bundle: TaskBundle,
    snapshots: Mapping[int, Checkpoint],
    views: Mapping[str, View],
    cases: list[Case],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per case, in order."""
    for step, seed in cases:
        episode = fake_trial(bundle, seed, "policy", success=seed % max(snapshots) < step, terms=terms)
        yield Attempt(seed=seed, episode=episode, placed=episode.objects[0])
