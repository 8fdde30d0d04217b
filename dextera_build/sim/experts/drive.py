"""Run an operator in an environment with action noise and filters, and record the episode."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.episode import Episode, Origin, Segment, Start
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.geometry import poses
from dextera_build.policy.cell import Guard, Stopped
from dextera_build.policy.observation import Measurement
from dextera_build.sim.control.ik import UNSOLVED
from dextera_build.sim.control.operator import Command, GaveUp, Operator, Part, PoseControl, State
from dextera_build.sim.experts.filters import Filters, Watch
from dextera_build.sim.experts.noise import Disturbance, Noise
from dextera_build.sim.runtime.environment import Environment, Outcome
from dextera_build.sim.runtime.recorder import Recorder

HELD_S = 1.0
"""Duration for which the robot holds still if the operator gives up at once, so that the episode shows the start
[s]."""


class Observer(Protocol):
    """An observer of a running episode."""

    def sent(self, command: Command) -> None:
        """Joint targets for a command are on their way to the controllers."""

    def stepped(self, outcome: Outcome) -> None:
        """A control period has passed."""


class Driver:
    """Runs operators in one environment.

    Args:
        environment: The task; the driver begins its episodes.
        settle_rad_s: See `PoseControl`.
        apart_m: See `PoseControl`.
        limits: Limits of a guard that all targets pass, as those of a robot's cell do; None: those of the joints alone.
    """

    def __init__(
        self,
        environment: Environment,
        settle_rad_s: float = np.inf,
        apart_m: float = 0.0,
        limits: Limits | None = None,
    ) -> None:
        self.environment = environment
        robot, rate = environment.bundle.robot, environment.task.control_hz
        self.control, self.noisy = (PoseControl(robot, rate, settle_rad_s, apart_m) for _ in range(2))
        self.watch = Watch(environment)
        self._feels = limits is not None and limits.force_n is not None
        self._guard = None if limits is None else Guard(limits, robot, rate, self._places_of_palms)

    def begin(self) -> None:
        """Follow commands from the environment's present targets on."""
        for control in (self.control, self.noisy):
            control.begin(self.environment.previous_action)
        if self._guard is not None:
            self._guard.begin(self.environment.previous_action)
        self.watch.begin()

    def follow(self, command: Command) -> np.ndarray:
        """Joint targets (A,) for the next control step [rad], which the guard has passed; later ones go on from them.

        Raises:
            Stopped: The guard stops the robot.
        """
        action = self.control.follow(command)
        if self._guard is None:
            return action
        forces = self.environment.contact_forces() if self._feels else np.zeros((0, 3))
        passed = self._guard.passed(action, forces, 0.0)
        self.control.begin(passed)
        return passed

    def _places_of_palms(self, joints: np.ndarray) -> np.ndarray:
        """Positions (L, 3) of the palms at joints (A,) in the base [m]."""
        robot = self.environment.bundle.robot
        arms = self.control.arms(robot.limb_names)
        names = [joint.name for joint in robot.joints]
        return np.asarray(arms.poses(joints[[names.index(name) for name in arms.joints]])[:, :3, 3])

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
        observer: Observer | None = None,
    ) -> Episode:
        """Run `operator` from `start` and return the episode; a failed one contains the reason.

        Without success it ends after `longest_s`, or after the task's own limit [s]. `observer` changes nothing.
        """
        self.environment.begin(start)
        run = _Run(self, operator, Disturbance(noise or Noise(), seed), filters or Filters(), observer)
        try:
            reason = run.to_its_end(longest_s)
        except UNSOLVED:
            reason = f"the inverse kinematics found no solution in `{run.segment}`"
        except GaveUp as verdict:
            reason = str(verdict)
        except Stopped as stopped:
            reason = stopped.message
        if not len(run.recorder):
            run.hold()
        return run.recorder.episode(origin, success=not reason, reason=reason, segments=run.labels.segments())

    def state(self) -> State:
        """The operator's current observation."""
        return state_of(self.environment.bundle, self.environment.measure())


class _Run:
    """One episode of a driver, whose environment has begun it."""

    def __init__(
        self,
        driver: Driver,
        operator: Operator,
        disturbance: Disturbance,
        limits: Filters,
        observer: Observer | None,
    ) -> None:
        self._driver, self._operator, self._limits, self._observer = driver, operator, limits, observer
        self._environment, self._disturbance = driver.environment, disturbance
        self.recorder, self.labels = Recorder(driver.environment), _Labels()
        self.segment = "the plan"
        self._apart = False
        # Number of the first control period with success.
        self._since = 0

    def to_its_end(self, longest_s: float) -> str:
        """Run the operator; the reason of a failure, empty for a success.

        Raises:
            GaveUp: The operator finds no plan, or lost the object.
            Stopped: The guard stopped the robot.
        """
        driver = self._driver
        self._operator.begin(driver.state())
        driver.begin()
        last: Command | None = None
        while True:
            command = self._operator.command(driver.state()) or last
            if command is None:
                return "the operator did nothing"
            last, self.segment = command, command.segment
            over, reason = self._verdict(command, self._step(command), longest_s)
            if over:
                return reason

    def hold(self) -> None:
        """Repeat the first action, at most for `HELD_S`."""
        action = self._environment.previous_action
        for _ in range(round(HELD_S * self._environment.task.control_hz)):
            self.recorder.before(action)
            outcome = self._environment.step(action)
            self.recorder.after(outcome.executed)
            if outcome.over:
                break

    def _step(self, command: Command) -> Outcome:
        driver = self._driver
        # After a perturbation the joints of label and robot may differ at the same pose of the palm.
        self._apart = self._apart or bool(command.off) or not self._disturbance.is_still
        action = driver.follow(command)
        sent = action
        if self._apart:
            sent = driver.noisy.follow(self._disturbance.on(replace(command, aims={**command.aims, **command.off})))
        else:
            driver.noisy.begin(action)
        if self._observer:
            self._observer.sent(command)
        self.recorder.before(action, self._palms(command))
        self.labels.add(command)
        driver.watch.expect(command, self._limits)
        outcome = self._environment.step(sent, driver.watch.look)
        self.recorder.after(outcome.executed)
        if self._observer:
            self._observer.stepped(outcome)
        return outcome

    def _verdict(self, command: Command, outcome: Outcome, longest_s: float) -> tuple[bool, str]:
        """Whether the episode has ended, and the reason of a failure."""
        environment, limits = self._environment, self._limits
        control = self._driver.control
        near = next((f"`{one}` near `{other}`" for one, other in control.met(command)), "")
        reason = self._driver.watch.fault(command, control.lag_m(command), control.targets, near)
        if reason:
            return True, reason
        if outcome.success:
            self._since = self._since or environment.steps
            lasted_s = environment.task.hold_s + (environment.steps - self._since) * environment.period_s
            return lasted_s >= limits.hold_s - 1e-9, ""
        if self._since:
            return True, "the success did not last"
        if not outcome.over and environment.steps * environment.period_s >= longest_s:
            why = environment.judge.reasons[0] or "not held for long enough"
            return True, f"not done when the operator stopped: {why}"
        return outcome.over, outcome.reason

    def _palms(self, command: Command) -> np.ndarray:
        """Commanded palm poses (L, 7) in the base; current poses for limbs without a command."""
        found = self._environment.palm_poses()
        for row, name in enumerate(self._environment.bundle.robot.limb_names):
            if name in command.aims:
                found[row] = poses.from_matrix(command.aims[name].palm)
        return found


def state_of(bundle: TaskBundle, measured: Measurement) -> State:
    """An operator's observation from a measurement of the task."""
    placed = zip(bundle.objects, measured.objects, strict=True)
    inner = zip(bundle.displacement_names, map(float, measured.displacement), strict=True)
    return State(
        joints=measured.joints,
        objects={name: poses.to_matrix(pose) for name, pose in placed},
        displacement=dict(inner),
    )


class _Labels:
    """Segments of a recording: runs of control steps in which some limbs do the same."""

    def __init__(self) -> None:
        self._steps = 0
        self._found: dict[tuple[Part, tuple[str, ...], int], int] = {}
        self._open: dict[tuple[Part, tuple[str, ...]], int] = {}

    def add(self, command: Command) -> None:
        limbs: dict[Part, tuple[str, ...]] = {}
        for limb in command.aims:
            limbs[command.part(limb)] = (*limbs.get(command.part(limb), ()), limb)
        self._open = {both: self._open.get(both, self._steps) for both in limbs.items()}
        self._steps += 1
        self._found |= {(*both, first): self._steps for both, first in self._open.items()}

    def segments(self) -> tuple[Segment, ...]:
        ordered = sorted(self._found.items(), key=lambda item: item[0][2])
        return tuple(
            Segment(name=part.segment, first=first, last=last, frame=part.frame, contact=part.contact, limbs=limbs)
            for (part, limbs, first), last in ordered
        )
