"""evaluate.operator_trials without a simulator: nine of ten trials succeed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .operator_trials import Case

BACKEND = Backend(summary="no simulation: nine of ten tries succeed", profiles=("stub",))


def operated(ctx: Context, twin: TaskBundle, cases: list[Case], options: Options) -> Iterator[Attempt]:
    """One attempt per case, in order."""
    for case in cases:
        episode = fake_trial(case.world, case.seed, "policy", success=case.seed % 10 > 0)
        yield Attempt(seed=case.seed, episode=episode, placed=episode.objects[0])


def stills(
    ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Options
) -> np.ndarray | None:
    """No pictures."""
    return None
