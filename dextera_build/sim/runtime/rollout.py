"""Run one episode: a policy in closed loop, or recorded joint targets in open loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.policy.cell import RobotCell
from dextera_build.policy.observation import DeployableObservation, Frames, deployable
from dextera_build.policy.running import PolicyFault
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.recorder import Recorder

Look = Callable[[], Frames]
"""Returns the frames of cameras in the environment's current state."""


class Acting(Protocol):
    """The interface of a policy in a rollout."""

    def reset(self) -> None:
        """Clear state from the previous episode."""

    def act(self, observation: DeployableObservation) -> np.ndarray:
        """Joint targets (A,) [rad].

        Raises:
            PolicyFault: There is no usable action.
        """


class SimulatedCell(RobotCell, Protocol):
    """A cell in a simulated world, which can be set to any start."""

    def begin(self, start: Start) -> str:
        """Begin an episode of the measured environment; returns the reason if that is not possible, or empty."""


def closed_loop(
    environment: Environment, policy: Acting, start: Start, look: Look | None = None, cell: SimulatedCell | None = None
) -> Episode:
    """Run `policy` from `start`; without a usable action the episode fails with the reason.

    Args:
        environment: The task; the episode is begun here, without state from an earlier one.
        policy: Receives only deployable observations.
        start: Start of the episode.
        look: Cameras of an image policy; called once per control period.
        cell: Measures and sends instead of the simulator. The episode and its success are nevertheless those of the
            true state.
    """
    refused = begin(environment, start, cell)
    policy.reset()
    recorder = Recorder(environment)
    if refused:
        return recorder.episode("policy", success=False, reason=refused)
    driven: RobotCell = environment if cell is None else cell
    while True:
        try:
            seen = driven.measure(look() if look else None)
            action = policy.act(deployable(seen, environment.previous_action, environment.goal, environment.added))
            recorder.before(action)
            recorder.after(driven.send(action))
        except PolicyFault as fault:
            return recorder.episode("policy", success=False, reason=fault.message)
        outcome = environment.outcome
        if outcome.over:
            return recorder.episode("policy", success=outcome.success, reason=outcome.reason)


def begin(environment: Environment, start: Start, cell: SimulatedCell | None) -> str:
    """Begin an episode, measured by a cell if there is one; returns the reason if that is not possible, or empty."""
    if cell is not None:
        return cell.begin(start)
    environment.begin(start)
    return ""


def through_cell(environment: Environment, cell: SimulatedCell, rehearsal: Episode, linger_s: float = 1.0) -> Episode:
    """Send the joint targets of a rehearsal through a cell, and record the episode as hardware gives it.

    Observations are the cell's measurements, and nothing is recorded that only a simulator knows; success is that of
    the true state, as a person who watches would say.

    Args:
        environment: The task; the cell has begun the episode.
        cell: Measures and sends.
        rehearsal: An episode in the twin, whose executed targets are sent, one per control period.
        linger_s: Time to hold the last target afterwards [s], because success needs time to be confirmed.
    """
    recorder = Recorder(environment, measured=True)
    held = [len(rehearsal.executed) - 1] * round(linger_s / environment.period_s)
    done, reason = False, "not done when the trajectory was over"
    for row in [*range(len(rehearsal.executed)), *held]:
        try:
            seen = deployable(cell.measure(), environment.previous_action, environment.goal, environment.added)
            recorder.before(rehearsal.action[row], rehearsal.hand[row], seen)
            recorder.after(cell.send(rehearsal.executed[row]))
        except PolicyFault as fault:
            reason = fault.message
            break
        if environment.outcome.over:
            done, reason = environment.outcome.success, environment.outcome.reason
            break
    made = recorder.episode("replay", success=done, reason=reason, segments=rehearsal.segments)
    return made.model_copy(update={"sources": rehearsal.sources})


def open_loop(environment: Environment, start: Start, targets: np.ndarray, linger_s: float = 1.0) -> Episode:
    """Run a recorded trajectory from `start`, without feedback.

    Args:
        environment: The task; the episode is begun here.
        start: Start of the episode.
        targets: Joint targets (T, A) [rad], one per control period.
        linger_s: Time to hold the last target afterwards [s], because success needs time to be confirmed.
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
