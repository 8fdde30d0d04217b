"""evaluate.replay without a simulator: every rollout succeeds in the twin, nine of ten in the other world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.trials import Attempt
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.runtime.fake_trials import fake_trial

if TYPE_CHECKING:
    from .replay import ReplayOptions

BACKEND = Backend(summary="no simulation: nine of ten replays succeed", profiles=("stub",))


def replays(
    ctx: Context,
    twin: TaskBundle,
    world: TaskBundle,
    sources: Episodes,
    cell: Cell | None,
    seeds: list[int],
    common: ReplayOptions,
    options: Options,
) -> Iterator[Attempt]:
    """One attempt per seed, in order."""
    for seed in seeds:
        rehearsal = fake_trial(twin, seed, "synthesis", success=True)
        episode = fake_trial(world, seed, "replay", success=seed % 10 > 0)
        yield Attempt(seed=seed, episode=episode, placed=episode.objects[0], rehearsal=rehearsal)


def stills(
    ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Options
) -> np.ndarray | None:
    """No pictures."""
    return None
