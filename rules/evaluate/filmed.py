"""Pictures of trials, rendered by MuJoCo."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Options
from dextera_build.sim.render.stills import Stills


def stills(
    ctx: Context, bundle: TaskBundle, episode: Episode, rows: np.ndarray, view: View | None, options: Options
) -> np.ndarray | None:
    """Pictures (len(rows), H, W, 3) uint8 of an episode of `bundle` at `rows`."""
    return Stills(bundle, view).at(episode, rows)
