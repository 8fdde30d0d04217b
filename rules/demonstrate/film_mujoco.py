"""demonstrate.film rendered by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.observation import Frame
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import pictures

if TYPE_CHECKING:
    from .film import FilmOptions

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def frames(
    ctx: Context, bundle: TaskBundle, episodes: Episodes, view: View, common: FilmOptions, options: Options
) -> Iterator[tuple[str, Frame]]:
    """Index and frames of each episode."""
    return pictures.film(bundle, episodes, view, ("rgb", "depth") if common.depth else ("rgb",), common.camera)
