"""evaluate.rollouts without simulator and network: nine of ten trials succeed for every policy."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

BACKEND = Backend(summary="no simulation: nine of ten tries succeed", profiles=("stub",))


def rollouts(
    ctx: Context,
    bundle: TaskBundle,
    checkpoint: Checkpoint,
    views: Mapping[str, View],
    cell: Cell | None,
    twin: TaskBundle | None,
    seeds: list[int],
    terms: tuple[TermSpec, ...],
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per seed, in order."""
    for seed in seeds:
        episode = fake_trial(bundle, seed, "policy", success=seed % 10 > 0, terms=terms)
        yield Attempt(seed=seed, episode=episode, placed=episode.objects[0])


def stills(
    ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Options
) -> np.ndarray | None:
    """No pictures."""
    return None
