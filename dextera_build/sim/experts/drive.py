"""Run an operator in an environment with action noise and filters, and record the episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Origin, Segment, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import lie, poses, transforms
from dextera_build.policy.observation import Measurement
from dextera_build.sim.control.operator import Aim, Command, Operator, OutOfReach, PoseControl, State
from dextera_build.sim.observe.touch import Touch
from dextera_build.sim.runtime.environment import Environment, Outcome
from dextera_build.sim.runtime.recorder import Recorder

HELD_S = 1.0
"""Duration for which the robot holds still if the operator gives up at once, so that the episode shows the start
[s]."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the action noise of Eq. 4d, which never enters the label."""

    position_m: float = 0.0
    """Noise of the palm's position, per axis [m]."""
    rotation_rad: float = 0.0
    """Noise of the palm's rotation vector, per axis, applied from the right [rad]."""
    finger_rad: float = 0.0
    """Noise of every finger joint [rad]."""
    correlation: float = 0.8
    """Correlation of noise in consecutive steps, 0..1; white noise would shake the arm."""
    in_contact: bool = False
    """Whether to add noise in segments with intended contact, too."""


@dataclass(frozen=True)
class Filters:
    """Limits whose violation discards an episode."""

    lag_m: float = 0.02
    """Maximum lag of joint targets behind the commanded palm due to position and speed limits [m]."""
    press_n: float = 1.0
    """Maximum force of an unintended contact [N]."""
    fingers: bool = False
    """Whether parts of hands may touch each other at any time, as a person's do, and not in contact with the task's
    object alone."""


class Watch(Protocol):
    """Whoever looks on while an episode runs."""

    def sent(self, command: Command) -> None:
        """Joint targets for a command are on their way to the controllers."""

    def stepped(self, outcome: Outcome) -> None:
        """A control period has passed."""


class Driver:
    """Runs operators in one environment.

    Args:
        environment: The task; the driver begins its episodes.
    """

    def __init__(self, environment: Environment) -> None:
        self.environment = environment
        self.control = PoseControl(environment.bundle.robot, environment.task.control_hz)
        self._noisy = PoseControl(environment.bundle.robot, environment.task.control_hz)
        self._touch = Touch(environment)

    def run(
        self,
        operator: Operator,
        start: Start,
        *,
        origin: Origin,
        noise: Noise | None = None,
        filters: Filters | None = None,
        seed: int = 0,
        longest_s: float = np.inf,
        watch: Watch | None = None,
    ) -> Episode:
        """Run `operator` from `start` and return the episode; a failed one contains the reason.

        Without success it ends after `longest_s`, or after the task's own limit [s]. `watch` changes nothing.
        """
        environment, rules = self.environment, filters or Filters()
        environment.begin(start)
        recorder, labels = Recorder(environment), _Labels()
        disturbance = _Disturbance(noise, seed) if noise else None
        try:
            operator.begin(self.state())
        except OutOfReach as verdict:
            self._hold(recorder)
            return recorder.episode(origin, success=False, reason=str(verdict))
        for control in (self.control, self._noisy):
            control.begin(environment.previous_action)
        last: Command | None = None
        while True:
            command = operator.command(self.state()) or last
            if command is None:
                return recorder.episode(origin, success=False, reason="the operator did nothing")
            last = command
            action = self.control.follow(command)
            sent = self._noisy.follow(disturbance.on(command)) if disturbance else action
            if watch:
                watch.sent(command)
            recorder.before(action, self._palms(command))
            labels.add(command)
            outcome = environment.step(sent)
            recorder.after(outcome.executed)
            if watch:
                watch.stepped(outcome)
            reason = self._fault(command, rules) or outcome.reason
            if not outcome.over and environment.steps * environment.period_s >= longest_s:
                why = environment.judge.reasons[0] or "not held for long enough"
                reason = reason or f"not done when the operator stopped: {why}"
            if reason or outcome.over:
                done = outcome.success and not reason
                return recorder.episode(origin, success=done, reason=reason, segments=labels.segments())

    def _hold(self, recorder: Recorder) -> None:
        """Repeat the first action, at most for `HELD_S`."""
        action = self.environment.previous_action
        for _ in range(round(HELD_S * self.environment.task.control_hz)):
            recorder.before(action)
            outcome = self.environment.step(action)
            recorder.after(outcome.executed)
            if outcome.over:
                break

    def _palms(self, command: Command) -> np.ndarray:
        """Commanded palm poses (L, 7) in the base; current poses for limbs without a command."""
        found = self.environment.palm_poses()
        for row, name in enumerate(self.environment.bundle.robot.limb_names):
            if name in command.aims:
                found[row] = poses.from_matrix(command.aims[name].palm)
        return found

    def _fault(self, command: Command, rules: Filters) -> str:
        if self.control.lag_m(command) > rules.lag_m:
            return f"limits of the arm's joints or speeds held the hand back in `{command.segment}`"
        touched = self._touch.unintended(command.contact, rules.press_n, fingers=rules.fingers)
        return f"touched `{touched}` in `{command.segment}`" if touched else ""

    def state(self) -> State:
        """The operator's current observation."""
        return state_of(self.environment.bundle, self.environment.measure())


def state_of(bundle: TaskBundle, measured: Measurement) -> State:
    """An operator's observation from a measurement of the task."""
    placed = zip(bundle.objects, measured.objects, strict=True)
    inner = zip(bundle.displacement_names, map(float, measured.displacement), strict=True)
    return State(
        joints=measured.joints,
        objects={name: poses.to_matrix(pose) for name, pose in placed},
        displacement=dict(inner),
    )


class _Disturbance:
    """Noise of one episode: a stationary first-order process with the same spread in every step."""

    def __init__(self, noise: Noise, seed: int) -> None:
        self._noise = noise
        self._random = np.random.default_rng([seed, 1])
        self._value: np.ndarray | None = None

    def on(self, command: Command) -> Command:
        """The command with noise, or unchanged if noise is off."""
        noise = self._noise
        size = sum(6 + len(aim.fingers) for aim in command.aims.values())
        drawn, keep = self._random.standard_normal(size), noise.correlation
        before = self._value
        if before is None or len(before) != size:
            before, keep = drawn, 1.0
        self._value = keep * before + np.sqrt(1 - keep**2) * drawn
        if command.contact and not noise.in_contact:
            return command
        aims, first = {}, 0
        for name, aim in command.aims.items():
            last = first + 6 + len(aim.fingers)
            aims[name], first = _disturbed(aim, self._value[first:last], noise), last
        return Command(aims, command.segment, command.frame, command.contact)


def _disturbed(aim: Aim, value: np.ndarray, noise: Noise) -> Aim:
    """A limb's target with the noise `value` (6 + H,), standard normal."""
    shift = transforms.rigid(lie.rotation(value[3:6] * noise.rotation_rad), np.zeros(3))
    palm = aim.palm @ shift
    palm[:3, 3] += value[:3] * noise.position_m
    return Aim(palm, aim.fingers + value[6:] * noise.finger_rad)


class _Labels:
    """Runs of equal segment labels."""

    def __init__(self) -> None:
        self._runs: list[tuple[Command, int]] = []

    def add(self, command: Command) -> None:
        if self._runs and self._runs[-1][0].segment == command.segment:
            self._runs[-1] = (self._runs[-1][0], self._runs[-1][1] + 1)
        else:
            self._runs.append((command, 1))

    def segments(self) -> tuple[Segment, ...]:
        found, first = [], 0
        for command, count in self._runs:
            found.append(
                Segment(
                    name=command.segment,
                    first=first,
                    last=first + count,
                    frame=command.frame,
                    contact=command.contact,
                    limbs=tuple(command.aims),
                )
            )
            first += count
        return tuple(found)
