"""Measure worlds of a task in one process beside MuJoCo alone: the same models, targets, substeps and threads.

Every world observes, judges, rewards and begins again: the episodes are spread evenly over their length, so that each
round has its share of resets.
"""

from __future__ import annotations

import copy
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import numpy as np
from mujoco import rollout

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.training.practice import Practices
from dextera_build.sim.training.threads import Threads
from dextera_build.sim.training.vector import TaskVectorEnv
from dextera_build.testing import RuleRunner

PERIODS = 8
"""Control periods of a round; two decisions of PPO."""
WARM = 1
"""Rounds before those that count."""
NEAR = 0.05
"""Deviation of targets from home [rad or m]."""

Times = tuple[list[float], list[float]]
"""Wall and processor time of the rounds [s]."""


@dataclass(frozen=True)
class Found:
    """Times of one number of worlds."""

    worlds: int
    """Number of worlds."""
    ours: Times
    """`TaskVectorEnv.step`, with resets."""
    alone: Times
    """`mj_step` by as many threads, with the same targets."""
    rollout: Times
    """`mujoco.rollout` by as many threads, which begins every round with all bodies awake."""
    practice: Times
    """Decisions as `learn.ppo` takes them, with privileged observations and the arm's inverse kinematics."""
    physics: list[float]
    """Processor time of the physics of these decisions [s], in which the robot moves farther than in the others."""

    @property
    def practice_share(self) -> float:
        """Processor time of the physics over that of the decisions, the middle one of the rounds."""
        return float(np.median(np.array(self.physics) / np.array(self.practice[1])))

    def rate(self, times: Times) -> float:
        """Control periods per second of wall time, of all worlds together."""
        return self.worlds * PERIODS / float(np.median(times[0]))

    def share(self, times: Times, *, wall: bool = False) -> float:
        """Time of `mj_step` alone over that of the same periods with all else, the middle one of the rounds."""
        which = 0 if wall else 1
        return float(np.median(np.array(self.alone[which]) / np.array(times[which])))


def timed(times: Times, work: Callable[[], object]) -> None:
    """Add the time of some work."""
    wall, spent = time.perf_counter(), time.process_time()
    work()
    times[0].append(time.perf_counter() - wall)
    times[1].append(time.process_time() - spent)


def measured(bundle: TaskBundle, count: int, threads: int, rounds: int) -> Found:
    """Measure one number of worlds.

    Args:
        bundle: The task.
        count: Number of worlds.
        threads: Threads of each column.
        rounds: Rounds that count.
    """
    several = TaskVectorEnv(bundle, count, threads=threads)
    several.reset(seed=0)
    _spread(several)
    practices, decide = _practices(bundle, count, threads)
    parts = _physics_of(practices)
    raw = _Raw(several, threads)
    found = Found(count, ([], []), ([], []), ([], []), ([], []), [])
    for _ in range(WARM + rounds):
        targets = raw.targets()
        timed(found.ours, lambda sent=targets: [several.step(each) for each in sent])
        timed(found.alone, lambda sent=targets: raw.step(sent))
        timed(found.rollout, lambda sent=targets: raw.roll(sent))
        parts.clear()
        timed(found.practice, lambda: [decide() for _ in range(PERIODS // practices.every)])
        found.physics.append(sum(parts))
    several.close()
    practices.close()
    raw.close()
    cut = [tuple(part[WARM:] for part in times) for times in (found.ours, found.alone, found.rollout, found.practice)]
    return Found(count, *cut, found.physics[WARM:])


def _spread(several: TaskVectorEnv) -> None:
    """Let the episodes end one after the other."""
    for number, world in enumerate(several.worlds.environments):
        world.steps = round(world.task.timeout_s / world.period_s) * number // several.num_envs


def _practices(bundle: TaskBundle, count: int, threads: int) -> tuple[Practices, Callable[[], None]]:
    """Worlds of `learn.ppo` with its defaults, and a function that takes a random decision in each and begins anew."""
    with tempfile.TemporaryDirectory() as folder:
        stub = RuleRunner(folder).run("learn.ppo", backend="stub", bundle=bundle)
    assert isinstance(stub, Checkpoint)
    practices = Practices(bundle, stub.contract, count, threads=threads)
    practices.reset()
    random = np.random.default_rng(0)

    def decide() -> None:
        steps = practices.step(list(random.normal(0.0, 0.3, (count, practices.decisions)))).steps
        over = np.flatnonzero(steps.ended | steps.late).tolist()
        if over:
            practices.reset(over)

    return practices, decide


def _physics_of(practices: Practices) -> list[float]:
    """A list to which the physics of every world adds its processor time [s], thread by thread."""
    parts: list[float] = []

    def timed_advance(advance: Callable[[np.ndarray], None], target: np.ndarray) -> None:
        began = time.thread_time()
        advance(target)
        parts.append(time.thread_time() - began)

    for world in practices.worlds.environments:
        world.advance = partial(timed_advance, world.advance)  # type: ignore[method-assign]
    return parts


class _Raw:
    """The physics alone of the worlds of an environment.

    Args:
        several: The worlds; their models are copied as they are now.
        threads: Number of threads.
    """

    def __init__(self, several: TaskVectorEnv, threads: int) -> None:
        worlds = several.worlds.environments
        first = worlds[0]
        self._models = [copy.copy(world.model) for world in worlds]
        self._datas = [copy.copy(world.data) for world in worlds]
        self._actuators = [first.model.actuator("robot/" + joint.name).id for joint in first.bundle.robot.joints]
        self._home, self._substeps = first.previous_action.copy(), first.substeps
        self._random, self._threads = np.random.default_rng(0), Threads(threads, len(worlds))
        threads = min(threads, len(worlds))
        # It steps on the calling thread with 0.
        self._rollout = rollout.Rollout(nthread=threads if threads > 1 else 0)
        self._scratch = [mujoco.MjData(first.model) for _ in range(threads)]
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._states = np.zeros((len(worlds), mujoco.mj_stateSize(first.model, kind)))
        for row, model, data in zip(self._states, self._models, self._datas, strict=True):
            mujoco.mj_getState(model, data, row, kind)

    def targets(self) -> np.ndarray:
        """Targets (T, N, A) of a round."""
        shape = PERIODS, len(self._models), len(self._home)
        return (self._home + self._random.uniform(-NEAR, NEAR, shape)).astype(np.float32)

    def step(self, targets: np.ndarray) -> None:
        """Go on with the targets (T, N, A)."""
        for sent in targets:
            self._threads.each(lambda number, sent=sent: self._stepped(number, sent[number]), len(self._models))

    def roll(self, targets: np.ndarray) -> None:
        """Start again, with the targets (T, N, A)."""
        control = np.zeros((len(self._models), PERIODS * self._substeps, self._models[0].nu))
        control[:, :, self._actuators] = np.repeat(targets.swapaxes(0, 1), self._substeps, axis=1)
        self._rollout.rollout(self._models, self._scratch, self._states, control)

    def close(self) -> None:
        """End the threads."""
        self._threads.close()
        self._rollout.close()

    def _stepped(self, number: int, target: np.ndarray) -> None:
        data = self._datas[number]
        data.ctrl[self._actuators] = target
        mujoco.mj_step(self._models[number], data, self._substeps)
