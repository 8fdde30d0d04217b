"""evaluate.film without rendering: a bar that grows with time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .film import FilmOptions

BACKEND = Backend(summary="no rendering: a bar that grows with time", profiles=("stub",))


def pictures(
    ctx: Context,
    bundle: TaskBundle,
    episode: Episode,
    rows: np.ndarray,
    view: View | None,
    common: FilmOptions,
    options: Options,
) -> np.ndarray:
    """Pictures (len(rows), H, W, 3) uint8."""
    found = np.full((len(rows), common.width_px * 3 // 4, common.width_px, 3), 128, np.uint8)
    for number, picture in enumerate(found):
        picture[:, : (number + 1) * common.width_px // len(rows)] = 200
    return found
