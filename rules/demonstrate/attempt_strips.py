"""Film strips of attempts at a task, for the previews of operators."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.render.stills import Stills

from .film_strip import strip

SHOWN = 10
"""Pictures per strip."""


def attempt_strips(bundle: TaskBundle, episodes: Episodes) -> list[tuple[str, np.ndarray]]:
    """Captions and film strips (H, W, 3) uint8 of the first success and the first failure."""
    stills = Stills(bundle, None)
    shown = [("a demonstration", episode) for episode in list(episodes.items.values())[:1]]
    shown += [(f"failed: {episode.reason}", episode) for episode in list(episodes.failures.values())[:1]]
    pictures = []
    for caption, episode in shown:
        rows = np.linspace(0, max(0, len(episode.joints) - 1), SHOWN).round().astype(int)
        pictures.append((caption, strip(stills.at(episode, rows), SHOWN)))
    return pictures
