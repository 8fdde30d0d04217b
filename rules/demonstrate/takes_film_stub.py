"""demonstrate.takes_film without rendering: a bar that grows with time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .takes_film import TakesFilmOptions

BACKEND = Backend(summary="no rendering: a bar that grows with time", profiles=("stub",))


def frames(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    recording: HandStream,
    common: TakesFilmOptions,
    options: Options,
) -> Iterator[np.ndarray]:
    """Pictures (H, W, 3) uint8 of the takes."""
    for episode in episodes.in_order()[: common.first]:
        for step in range(len(episode[1].joints)):
            picture = np.full((common.width_px * 3 // 4, common.width_px, 3), 128, np.uint8)
            picture[:, : (step + 1) * common.width_px // len(episode[1].joints)] = 200
            yield picture
