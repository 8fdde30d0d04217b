"""demonstrate.film rendered by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import pictures

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def frames(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, options: Options
) -> Iterator[tuple[str, np.ndarray]]:
    """Index and frames (T, H, W, 3) uint8 of each episode."""
    return pictures.film(bundle, episodes, view)
