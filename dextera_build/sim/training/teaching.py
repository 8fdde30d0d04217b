"""Correction of a student by a teacher (DAgger, Ross et al. 2011): the student acts, the teacher says what it would do.

The teacher may see what only a simulator knows. What is recorded is what the student saw, through the given sensors,
and as the label of every step the teacher's joint targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Start
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import RuleError
from dextera_build.policy import contract as contracts
from dextera_build.policy.features import Reader, observed
from dextera_build.policy.layout import WORLD, of_bundle, world_flag
from dextera_build.policy.observation import deployable
from dextera_build.policy.running import Policy, PolicyFault, Runner
from dextera_build.sim.observe.progress import Progress
from dextera_build.sim.observe.sensors import Sensors
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.privileged import Simulated, values
from dextera_build.sim.runtime.recorder import Recorder
from dextera_build.sim.runtime.rollout import Look
from dextera_build.sim.training.insight import INSIGHT, insight


class Teacher:
    """The actions of a policy in the true state of a world, in which a student may be acting.

    Args:
        runner: The module `policy.py` of its algorithm.
        checkpoint: The policy, with or without privileged inputs.
        environment: The world.

    Raises:
        RuleError: It was trained for another task or robot, looks at pictures, or depends on earlier observations.
    """

    def __init__(self, runner: Runner, checkpoint: Checkpoint, environment: Environment) -> None:
        contract = checkpoint.contract
        contracts.check(contract, environment.bundle, terms=environment.specs, teacher=True)
        if contract.sees or contract.history > 1:
            what = "looks at pictures" if contract.sees else "remembers"
            raise RuleError(
                f"a policy of `learn.{contract.algorithm}` that {what} is no teacher",
                code="DXB-B517",
                hint="give a checkpoint that decides from the present state, such as one of `learn.ppo`",
            )
        layout = of_bundle(environment.bundle, terms=environment.specs)
        self._environment = environment
        self._reader, self._world = Reader(contract.inputs, layout), world_flag(layout.world)[None]
        self._predict = runner.predict(checkpoint, environment.bundle)
        self._limbs = str(contract.settings["limb"]).split() if contract.settings.get(contracts.PRIVILEGED) else []
        self._simulated, self._progress = Simulated([environment]), Progress(environment)
        self._limits = np.array([(joint.lower, joint.upper) for joint in environment.bundle.robot.joints])
        self._every = int(contract.settings.get("every", 1))
        self._planned = np.zeros((0, len(self._limits)))
        """Targets of the last decision for the periods that it has left (n, A)."""

    def targets(self, acted: bool) -> np.ndarray:
        """Joint targets (A,) [rad] for the coming control period, within limits.

        A decision lasts as long as in the teacher's practice, but only while the teacher acts. Where a student acted,
        the answer is the first step of a new decision in the state that the student led to.

        Args:
            acted: Whether the last targets were carried out.

        Raises:
            PolicyFault: They are not finite.
        """
        world = self._environment
        if not len(self._planned) or not acted or world.steps == 0:
            self._planned = self._decided()[: self._every]
        made, self._planned = self._planned[0], self._planned[1:]
        if not np.isfinite(made).all():
            raise PolicyFault(f"the teacher gave NaN at step {world.steps}", code="DXB-B511")
        return np.asarray(np.clip(made, self._limits[:, 0], self._limits[:, 1]))

    def _decided(self) -> np.ndarray:
        """Joint targets (C, A) [rad] for the coming control periods."""
        world = self._environment
        inputs = self._reader.read(observed(world.observe()) | {WORLD: self._world})
        if self._limbs:
            value = self._progress.value(False, world.now)
            inputs[INSIGHT] = insight([world], self._limbs, values(self._simulated), [value])
        return self._predict(inputs, world.steps)


@dataclass(frozen=True)
class Lesson:
    """An episode of a student, with the teacher's answers."""

    episode: Episode
    """Recorded observations are the student's, `action` is the teacher's and `executed` what was sent."""
    apart_rad: float
    """Mean difference between the targets of both [rad]; 0 without a student."""


def lesson(
    environment: Environment,
    teacher: Teacher,
    student: Policy | None,
    start: Start,
    sensors: Sensors,
    *,
    led: float = 0.0,
    look: Look | None = None,
) -> Lesson:
    """Run a student from `start`, and ask its teacher at every step.

    Args:
        environment: The world; the episode is begun here.
        teacher: Sees the true state.
        student: Acts on measurements; None: the teacher acts.
        start: Start of the episode.
        sensors: Their noise, delay and losses, drawn from the seed of the start.
        led: Probability that the teacher acts in a control period, 0..1.
        look: Cameras of a student that sees.
    """
    environment.begin(start)
    sensors.reset(start.seed, start.variation.noise)
    if student is not None:
        student.reset()
    random = np.random.default_rng([start.seed, 7])
    recorder, apart, acted = Recorder(environment), list[float](), True
    while True:
        frames = look() if look else None
        seen = sensors.measure(environment.measure(frames), environment.steps * environment.period_s)
        shown = deployable(seen, environment.previous_action, environment.goal, environment.added)
        try:
            wanted = teacher.targets(acted)
            taken = wanted if student is None else student.act(shown)
        except PolicyFault as fault:
            return Lesson(recorder.episode("policy", success=False, reason=fault.message), _mean(apart))
        apart.append(float(np.abs(taken - wanted).mean()))
        recorder.before(wanted, seen=shown)
        leads = random.uniform() < led
        acted = leads or student is None
        outcome = environment.step(wanted if leads else taken)
        recorder.after(outcome.executed)
        if outcome.over:
            made = recorder.episode("policy", success=outcome.success, reason=outcome.reason)
            return Lesson(made, _mean(apart))


def _mean(values: list[float]) -> float:
    return float(np.mean(values)) if values else 0.0
