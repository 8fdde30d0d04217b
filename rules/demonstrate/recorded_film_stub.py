"""demonstrate.recorded_film without rendering."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.observation import Frame
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .recorded_film import RecordedFilmOptions

BACKEND = Backend(summary="no rendering: grey frames", profiles=("stub",))


def frames(
    ctx: Context, world: TaskBundle, episodes: Episodes, view: View, common: RecordedFilmOptions, options: Options
) -> Iterator[tuple[str, Frame]]:
    """Index of each episode, and its frames with a leading axis of T steps."""
    for index, episode in episodes.items.items():
        size = (len(episode.joints), view.camera.height, view.camera.width)
        yield index, Frame(np.full((*size, 3), 128, np.uint8), np.ones(size, np.float32) if common.depth else None)
