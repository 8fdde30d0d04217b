"""What the runtime costs on top of MuJoCo: control periods with observation and verdict, beside bare `mj_step`.

`make bench` runs it on a small hand-made task, whose physics is so cheap that everything else weighs most;
`DXB_BENCH_BUNDLE=cache/out/task/close_laptop/task/task.bundle make bench` on a built one.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

pytestmark = pytest.mark.slow

PERIODS, ROUNDS = 20, 15


def bundle() -> TaskBundle:
    path = os.environ.get("DXB_BENCH_BUNDLE")
    return unpack(TaskBundle, Path(path).read_bytes()) if path else task_bundles.lift()


def test_stepping_beside_bare_mujoco(capsys):
    environment = Environment(bundle())
    model, bare = environment.model, mujoco.MjData(environment.model)
    random = np.random.default_rng(0)
    home = environment.previous_action
    rates: dict[str, list[float]] = {"bare": [], "runtime": []}
    for _ in range(ROUNDS):
        environment.begin(environment.start)
        targets = home + random.uniform(-0.05, 0.05, (PERIODS, len(home)))
        began, sent = time.process_time(), []
        for target in targets:
            sent.append(environment.step(target).executed)
            environment.observe()
        rates["runtime"].append(PERIODS / (time.process_time() - began))
        mujoco.mj_resetData(model, bare)
        bare.qpos[:], bare.ctrl[:] = environment.start.qpos, environment.start.ctrl
        mujoco.mj_forward(model, bare)
        began = time.process_time()
        for target in sent:
            bare.ctrl[environment._actuators] = target
            mujoco.mj_step(model, bare, environment.substeps)
        rates["bare"].append(PERIODS / (time.process_time() - began))
    share = np.median(np.array(rates["runtime"]) / np.array(rates["bare"]))
    with capsys.disabled():
        print(f"\n{environment.task.name}: {model.nv} degrees of freedom, {environment.substeps} substeps")
        for name, values in rates.items():
            print(f"  {name:8} {np.median(values):8.0f} control periods/s")
        print(f"  share    {100 * share:8.0f} % (target 60 %)")
    assert share > 0.2
