"""demonstrate.operate without a simulator: nothing moves, and every episode succeeds."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.episode import Episodes
from dextera_build.artifacts.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.rule import Backend
from dextera_build.sim.runtime.pretence import pretended

if TYPE_CHECKING:
    from .operate import OperateOptions

BACKEND = Backend(summary="no simulation: nothing moves, and every episode succeeds", profiles=("stub",))


def operate(bundle: TaskBundle, options: OperateOptions, progress: Callable[[int, int, str], None]) -> Episodes:
    """Return the requested number of motionless episodes."""
    items = {
        f"{number:05d}": pretended(bundle, options.seed + number, "operator", success=True)
        for number in range(options.episodes)
    }
    return layout.gathered(bundle, items, {}, options.episodes)


def strips(bundle: TaskBundle, episodes: Episodes) -> list[tuple[str, np.ndarray]]:
    """No pictures."""
    return []
