"""Measure a task of dxb beside MuJoCo alone: control periods, resets and pictures.

Both sides of a ratio are measured in turn in short rounds, in processor time of all threads, because other work on the
machine and the clock of its processor change from second to second; the middle ratio of the rounds counts.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.render import portrait, rendering
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.gym import TaskEnv

PERIODS = 20
"""Control periods of a round."""
WARM = 3
"""Rounds before those that count."""


@dataclass(frozen=True)
class Stepped:
    """Control periods of one task in one process."""

    share: float
    """Time of `mj_step` alone over that of `TaskEnv.step`: with observations, reward and verdict."""
    runtime: float
    """The same of `Environment.step` and `observe`: with observations and verdict."""
    real_time: float
    """Simulated time over that of `TaskEnv.step`."""


def seconds(work: Callable[[], object]) -> float:
    """Processor time [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def stepped(bundle: TaskBundle, rounds: int, core: int | None = None) -> Stepped:
    """Compare periods with the same targets from the same start, of the same model: near home, most objects at rest.

    Args:
        bundle: The task.
        rounds: Rounds that count.
        core: Number of the core to stay on, among those of this process; None: any.
    """
    if core is not None:
        os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[core]})
    task = TaskEnv(bundle)
    environment, start = task.environment, task.environment.start
    model, bare = environment.model, mujoco.MjData(environment.model)
    actuators = [model.actuator("robot/" + joint.name).id for joint in bundle.robot.joints]
    home = environment.previous_action
    targets = home + np.random.default_rng(0).uniform(-0.05, 0.05, (PERIODS, len(home)))
    sent: list[np.ndarray] = []

    def alone() -> None:
        for target in sent:
            bare.ctrl[actuators] = target
            mujoco.mj_step(model, bare, environment.substeps)

    def observed() -> None:
        for target in targets:
            environment.step(target)
            environment.observe()

    times = []
    for _ in range(WARM + rounds):
        task.reset(options={"start": start})
        whole = seconds(lambda: sent.extend(task.step(target)[4]["executed"] for target in targets))
        mujoco.mj_resetData(model, bare)
        bare.qpos[:], bare.ctrl[:] = start.qpos, start.ctrl
        mujoco.mj_forward(model, bare)
        least = seconds(alone)
        environment.begin(start)
        times.append((whole, least, seconds(observed)))
        sent.clear()
    whole, least, partly = np.array(times[WARM:]).T
    period = environment.period_s * PERIODS
    return Stepped(
        *(float(np.median(each)) for each in (least / whole, least / partly, period / whole)),
    )


def side_by_side(bundle: TaskBundle, rounds: int, processes: int) -> list[Stepped]:
    """The same in several new processes at once, each on a core of its own."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        # All have started and imported what they need before any measures.
        list(pool.map(stepped, [bundle] * processes, [1] * processes))
        return list(pool.map(stepped, [bundle] * processes, [rounds] * processes, range(processes)))


def resets(bundle: TaskBundle, count: int) -> tuple[float, float]:
    """Median and 99 % quantile of the time of a reset from a seed [s]."""
    task = TaskEnv(bundle)
    times = [seconds(lambda now=seed: task.reset(seed=now)) for seed in range(count)]
    return float(np.median(times)), float(np.quantile(times, 0.99))


def pictures(bundle: TaskBundle, rounds: int, size: tuple[int, int]) -> float:
    """Time of a picture over that of `mujoco.Renderer`: the same pixels from the same model, through the same camera.

    Args:
        bundle: The task.
        rounds: Pairs that count.
        size: Width and height [px].
    """
    first = Environment(bundle)
    camera, pose = portrait.stand(first.model, first.data, *size)
    files = {name: data for name, data in bundle.model.files.items() if name != "scene.xml"}
    spec = mujoco.MjSpec.from_string(bundle.model.files["scene.xml"].decode(), assets=files)
    rendering.camera_spec(spec.worldbody, "benchmark", camera, pose)
    environment = Environment(bundle, spec.compile())
    with (
        rendering.Eye(environment.model, camera, pose) as eye,
        mujoco.Renderer(environment.model, camera.height, camera.width) as renderer,
    ):

        def stock() -> np.ndarray:
            renderer.update_scene(environment.data, "benchmark")
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                renderer.scene.flags[flag] = False
            return np.asarray(renderer.render())

        # The headlight is where MuJoCo's own camera would be, so shades differ a little.
        apart = np.abs(eye.rgb(environment.data).astype(int) - stock())
        assert (apart > 40).mean() < 1e-3, "both draw the same"
        return paired(lambda: eye.rgb(environment.data), stock, rounds)


def paired(one: Callable[[], object], other: Callable[[], object], rounds: int) -> float:
    """Median ratio of the times of two things that are done in turn, each first in every second round."""
    ratios = []
    for number in range(WARM + rounds):
        pair: Iterable[Callable[[], object]] = (one, other) if number % 2 else (other, one)
        times = {work: seconds(work) for work in pair}
        ratios.append(times[one] / times[other])
    return float(np.median(ratios[WARM:]))
