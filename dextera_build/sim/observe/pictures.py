"""Pictures of an episode from one camera, recorded or running, with the episode's camera error, light and exposure."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.observation import PICTURE
from dextera_build.sim.observe.eyes import Eyes
from dextera_build.sim.render.filming import Replica
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Look


def film(bundle: TaskBundle, episodes: Episodes, view: View) -> Iterator[tuple[str, np.ndarray]]:
    """Index and frames (T, H, W, 3) uint8 sRGB of each episode in `episodes.items`, without shadows.

    The images equal a policy's input during a rollout: same samples, same lights, same errors.
    """
    replica, views = Replica(bundle, episodes), {PICTURE: view}
    with closing(Eyes(replica.model, views, ["rgb"])) as eyes:
        for index, episode in episodes.items.items():
            eyes.vary(variations.seen(bundle, episode.start, views))
            yield index, np.stack([_recorded(replica, eyes, row) for row in replica.positions(episode)])


@contextmanager
def live(environment: Environment, view: View) -> Iterator[Look]:
    """Yield a function that renders the picture (H, W, 3) uint8 sRGB of the running episode's current state."""
    views = {PICTURE: view}
    with closing(Eyes(environment.model, views, ["rgb"])) as eyes:

        def look() -> np.ndarray:
            eyes.vary(variations.seen(environment.bundle, environment.start, views))
            return _rgb(eyes, environment.data)

        yield look


def _recorded(replica: Replica, eyes: Eyes, positions: np.ndarray) -> np.ndarray:
    replica.show(positions)
    return _rgb(eyes, replica.data)


def _rgb(eyes: Eyes, data: Any) -> np.ndarray:
    return np.asarray(eyes.look(data)[PICTURE].rgb)
