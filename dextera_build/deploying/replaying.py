"""Joint targets of an episode, sent to a robot one after another, whatever is measured (paper, Table IV)."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode
from dextera_build.policy.observation import DeployableObservation, Measurement
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.reconstruction import Tracker, reconstruct

LINGER_S = 1.0
"""Time for which the last targets are held [s], as in evaluate.replay."""


class Replaying:
    """Acts as an episode did.

    Args:
        targets: Its joint targets (T, A) [rad or m].
    """

    def __init__(self, targets: np.ndarray) -> None:
        self._targets, self._step = targets, 0

    def reset(self) -> None:
        """Begin anew."""
        self._step = 0

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) of this control period [rad or m]; after the last ones, these are held."""
        targets = self._targets[min(self._step, len(self._targets) - 1)]
        self._step += 1
        return np.asarray(targets, np.float64)


def begin(environment: Environment, episode: Episode, seed: int) -> None:
    """Begin in a world as an episode of another one began: robot and objects where they were measured then.

    Args:
        environment: The world, with the same robot, objects and joints.
        episode: The episode.
        seed: Seed of the world's own random numbers.
    """
    measured = Measurement(episode.joints[0], episode.objects[0], episode.displacement[0])
    environment.begin(reconstruct(measured, episode.start.ctrl, environment, Tracker(), seed))
