"""Runs of one episode: a policy in closed loop, or recorded joint targets in open loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from dextera_build.artifacts.episode import Episode, Start
from dextera_build.policy.observation import DeployableObservation
from dextera_build.policy.running import PolicyFault
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.recorder import Recorder

Look = Callable[[], np.ndarray]
"""A picture (H, W, 3) uint8 of the environment as it stands now."""


class Acting(Protocol):
    """The interface of a policy in a rollout."""

    def reset(self) -> None:
        """Forget the episode before."""

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad].

        Raises:
            PolicyFault: It has none that could be sent.
        """


def closed_loop(environment: Environment, policy: Acting, start: Start, look: Look | None = None) -> Episode:
    """The episode that `policy` brings about from `start`; one that gives no usable action has failed, with its reason.

    Args:
        environment: The task; begun here, so that nothing is left of an earlier episode.
        policy: Sees deployable observations alone.
        start: Where it begins.
        look: For policies that see; called once per control period.
    """
    environment.begin(start)
    policy.reset()
    recorder = Recorder(environment)
    while True:
        try:
            action = policy.act(environment.observe(look() if look else None))
        except PolicyFault as fault:
            return recorder.episode("policy", success=False, reason=fault.message)
        recorder.before(action)
        outcome = environment.step(action)
        recorder.after(outcome.executed)
        if outcome.over:
            return recorder.episode("policy", success=outcome.success, reason=outcome.reason)


def open_loop(environment: Environment, start: Start, targets: np.ndarray, linger_s: float = 1.0) -> Episode:
    """The episode that a recorded trajectory brings about from `start`, whatever happens meanwhile.

    Args:
        environment: The task; begun here.
        start: Where it begins.
        targets: Joint targets (T, A) [rad], one per control period.
        linger_s: The last target is held for so long afterwards [s], because a verdict takes its time.
    """
    environment.begin(start)
    recorder = Recorder(environment)
    held = np.repeat(targets[-1:], round(linger_s / environment.period_s), axis=0)
    for target in np.concatenate([targets, held]):
        recorder.before(target)
        outcome = environment.step(target)
        recorder.after(outcome.executed)
        if outcome.over:
            return recorder.episode("replay", success=outcome.success, reason=outcome.reason)
    return recorder.episode("replay", success=False, reason="not done when the trajectory was over")
