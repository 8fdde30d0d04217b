"""Pictures of an episode, recorded or running, with the episode's camera errors, light and exposure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields

import numpy as np

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.observe.eyes import Eyes
from dextera_build.sim.render.filming import Replica
from dextera_build.sim.runtime import variations
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Look


def film(
    bundle: TaskBundle,
    episodes: Episodes,
    view: View,
    outputs: Collection[str] = ("rgb",),
    camera: str = PICTURE,
) -> Iterator[tuple[str, Frame]]:
    """Index of each episode in `episodes.items`, and its frames with a leading axis of T steps, without shadows.

    The images equal a policy's input during a rollout: same samples, same lights, same errors, which depend on the name
    of the camera.
    """
    replica, views = Replica(bundle, episodes), {camera: view}
    with closing(Eyes(replica.model, views, outputs)) as eyes:
        for index, episode in episodes.items.items():
            eyes.vary(variations.seen(bundle, episode.start, views))
            yield index, stacked([_recorded(replica, eyes, row)[camera] for row in replica.positions(episode)])


@contextmanager
def live(environment: Environment, views: Mapping[str, View], outputs: Collection[str] = ("rgb",)) -> Iterator[Look]:
    """Yield a function that renders the frames of the running episode's current state.

    Args:
        environment: The task.
        views: Name -> camera.
        outputs: What a frame holds.
    """
    with closing(Eyes(environment.model, views, outputs)) as eyes:

        def look() -> Frames:
            eyes.vary(variations.seen(environment.bundle, environment.start, views))
            return eyes.look(environment.data)

        yield look


def stacked(frames: Sequence[Frame]) -> Frame:
    """The frames of one camera as one, with a leading axis."""
    every: dict[str, list[np.ndarray | None]] = {
        part.name: [getattr(frame, part.name) for frame in frames] for part in fields(Frame)
    }
    return Frame(**{name: None if each[0] is None else np.stack(each) for name, each in every.items()})  # type: ignore[arg-type]


def _recorded(replica: Replica, eyes: Eyes, positions: np.ndarray) -> Frames:
    replica.show(positions)
    return eyes.look(replica.data)
