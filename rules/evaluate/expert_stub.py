"""evaluate.expert without a simulator: the expert gets the full return, random actions get zero."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="no simulation: 1 for a success, 0 otherwise", profiles=("stub",))


def returns(
    ctx: Context, bundle: TaskBundle, episodes: Sequence[Episode], seed: int, options: Options
) -> tuple[np.ndarray, np.ndarray]:
    """Returns (N,) of the episodes, and of random actions from their starts."""
    own = np.array([float(episode.success) for episode in episodes])
    return own, np.zeros(len(episodes))
