"""What the runtime costs on top of MuJoCo: control periods, resets, and pictures beside those of `mujoco.Renderer`.

`make bench` runs it on a small hand-made task, whose physics is so cheap that everything else weighs most;
`DXB_BENCH_BUNDLE=cache/out/task/close_laptop/task/task.bundle make bench` on a built one. Parts are measured in turn,
in processor time; the fastest of many repetitions is compared, because other work on the machine only slows them down.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.task import TaskBundle
from dextera_build.sim.render import rendering
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.training.gym import TaskEnv
from tests import episodes, task_bundles

pytestmark = pytest.mark.slow

PERIODS, ROUNDS, RESETS = 20, 25, 60


def bundle() -> TaskBundle:
    path = os.environ.get("DXB_BENCH_BUNDLE")
    return unpack(TaskBundle, Path(path).read_bytes()) if path else task_bundles.lift()


def seconds(work: Callable[[], object]) -> float:
    """Processor time of all threads, those of a renderer in software included [s]."""
    began = time.process_time()
    work()
    return time.process_time() - began


def test_stepping_beside_bare_mujoco(capsys):
    task = TaskEnv(bundle())
    environment = task.environment
    model, bare = environment.model, mujoco.MjData(environment.model)
    random, home = np.random.default_rng(0), environment.previous_action
    actuators = [model.actuator("robot/" + joint.name).id for joint in environment.bundle.robot.joints]
    times: dict[str, list[list[float]]] = {"bare": [], "runtime": [], "gymnasium": []}

    def observed(target: np.ndarray) -> None:
        sent.append(environment.step(target).executed)
        environment.observe()

    def stepped(target: np.ndarray) -> None:
        bare.ctrl[actuators] = target
        mujoco.mj_step(model, bare, environment.substeps)

    targets = home + random.uniform(-0.05, 0.05, (PERIODS, len(home)))
    for _ in range(ROUNDS):
        sent: list[np.ndarray] = []
        environment.begin(environment.start)
        times["runtime"].append([seconds(lambda now=target: observed(now)) for target in targets])
        mujoco.mj_resetData(model, bare)
        bare.qpos[:], bare.ctrl[:] = environment.start.qpos, environment.start.ctrl
        mujoco.mj_forward(model, bare)
        times["bare"].append([seconds(lambda now=target: stepped(now)) for target in sent])
        task.reset(options={"start": environment.start})
        times["gymnasium"].append([seconds(lambda now=target: task.step(now)) for target in targets])
    # The same period has the same work in every round.
    best = {name: np.min(rounds, axis=0).mean() for name, rounds in times.items()}
    share = {name: best["bare"] / value for name, value in best.items()}
    with capsys.disabled():
        print(f"\n{environment.task.name}: {model.nv} degrees of freedom, {environment.substeps} substeps", end="")
        print(f" of {1e3 * model.opt.timestep:g} ms")
        for name, value in best.items():
            print(
                f"  {name:10} {1 / value:7.0f} control periods/s  {environment.period_s / value:6.1f} x real time",
                end="",
            )
            print(f"  {100 * share[name]:4.0f} % of bare")
    assert share["runtime"] > 0.3


def test_resets(capsys):
    task = TaskEnv(bundle())
    times = 1e3 * np.array([seconds(lambda now=seed: task.reset(seed=now)) for seed in range(RESETS)])
    with capsys.disabled():
        print(f"\nreset: median {np.median(times):.1f} ms, p99 {np.quantile(times, 0.99):.1f} ms of processor time")
    assert np.median(times) < 50


def test_pictures_beside_mujocos_own(capsys):
    environment = Environment(bundle())
    view = episodes.view(128, 96)
    camera = mujoco.MjvCamera()
    with rendering.through(environment.model, view) as eye, mujoco.Renderer(environment.model, 96, 128) as renderer:
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            renderer.scene.flags[flag] = False

        def stock() -> None:
            renderer.update_scene(environment.data, camera)
            renderer.render()

        pairs = [(seconds(lambda: eye.rgb(environment.data)), seconds(stock)) for _ in range(40)]
    ours, theirs = np.min(pairs, axis=0)
    with capsys.disabled():
        print(f"\npicture: {1e3 * ours:.1f} ms, `mujoco.Renderer` {1e3 * theirs:.1f} ms, ratio {ours / theirs:.2f}")
    assert ours / theirs < 2
