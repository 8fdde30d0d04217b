"""evaluate.film rendered by MuJoCo."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.render.stills import Stills

if TYPE_CHECKING:
    from .film import FilmOptions

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def pictures(
    ctx: Context,
    bundle: TaskBundle,
    episode: Episode,
    rows: np.ndarray,
    view: View | None,
    common: FilmOptions,
    options: Options,
) -> np.ndarray:
    """Pictures (len(rows), H, W, 3) uint8 of recorded states."""
    return Stills(bundle, view, common.width_px).at(episode, rows)
