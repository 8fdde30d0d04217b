"""evaluate.expert in MuJoCo: recorded actions are replayed, and random ones run from the same starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.runtime.environment import Environment

BACKEND = Backend(summary="MuJoCo", profiles=("cpu",), packages=("mujoco",), extra="twin")


def returns(
    ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], seed: int, options: Options
) -> tuple[np.ndarray, np.ndarray]:
    """Returns (N,) of the episodes, and of random actions from their starts."""
    environment = Environment(bundle)
    progress = Progress(environment)
    found = []
    for number, episode in enumerate(episodes):
        draws = np.random.default_rng([seed, number])
        steps = int(environment.task.timeout_s / environment.period_s + 0.5)
        random = draws.uniform(environment.lower, environment.upper, (steps, len(environment.lower)))
        pair = (_return(environment, progress, episode, each) for each in (episode.action, random))
        found.append(tuple(pair))
        ctx.progress(number + 1, len(episodes), "returns")
    own, other = np.array(found, np.float64).reshape(-1, 2).T
    return own, other


def _return(environment: Environment, progress: Progress, episode: Episode, actions: np.ndarray) -> float:
    """Sum of the rewards of actions (T, A); rewards are changes of the state's value."""
    environment.begin(episode.start)
    before = progress.value(False)
    for action in actions:
        outcome = environment.step(action)
        if outcome.over:
            return progress.value(outcome.success) - before
    return progress.value(False) - before
