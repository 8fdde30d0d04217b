"""demonstrate.recorded_film simulated and rendered by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame
from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.observe import pictures
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Look

if TYPE_CHECKING:
    from .recorded_film import RecordedFilmOptions

BACKEND = Backend(summary="MuJoCo through EGL", profiles=("cpu",), packages=("mujoco",), extra="twin")


def frames(
    ctx: Context, world: TaskBundle, episodes: Episodes, view: View, common: RecordedFilmOptions, options: Options
) -> Iterator[tuple[str, Frame]]:
    """Index of each episode, and its frames with a leading axis of T steps."""
    environment = Environment(world)
    with pictures.live(environment, {PICTURE: view}, ("rgb", "depth") if common.depth else ("rgb",)) as look:
        for index, episode in episodes.items.items():
            shown, apart = _again(environment, episode, look)
            ctx.check(
                apart <= common.apart_rad,
                f"episode `{index}` does not come out again: a joint is {apart:.3f} rad from where it was",
                hint="film it on a machine of the kind that recorded it",
            )
            yield index, pictures.stacked(shown)


def _again(environment: Environment, episode: Episode, look: Look) -> tuple[list[Frame], float]:
    """Frames of an episode that is run again, and the largest difference of a joint [rad or m]."""
    environment.begin(episode.start)
    shown, apart = list[Frame](), 0.0
    for joints, target in zip(episode.joints, episode.executed, strict=True):
        apart = max(apart, float(np.abs(environment.measure().joints - joints).max()))
        shown.append(look()[PICTURE])
        environment.step(target)
    return shown, apart
