"""Environments of other packages beside `mj_step` of their own models: run by an interpreter that has the packages.

Prints one line of JSON per environment: package, name, substeps and their length [s], share of `mj_step`, versions. It
imports nothing of dxb.
"""

from __future__ import annotations

import copy
import json
import sys
import time
from collections.abc import Callable
from importlib import metadata
from typing import Any

import mujoco
import numpy as np

PERIODS, WARM = 20, 3


def robosuite() -> tuple[str, Any, Any, int, Callable[[], object], Callable[[], object]]:
    """Lift with a Panda, state only."""
    import robosuite

    task = robosuite.make(
        "Lift",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        control_freq=20,
        ignore_done=True,
    )
    task.reset()
    low, high = task.action_spec
    random = np.random.default_rng(0)
    substeps = round(task.control_timestep / task.model_timestep)
    model, data = task.sim.model._model, task.sim.data._data
    return "Lift", model, data, substeps, task.reset, lambda: task.step(random.uniform(low, high) / 10)


def gymnasium_robotics() -> tuple[str, Any, Any, int, Callable[[], object], Callable[[], object]]:
    """FetchPickAndPlace."""
    import gymnasium
    import gymnasium_robotics

    gymnasium.register_envs(gymnasium_robotics)
    task = gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=10**6)
    task.reset(seed=0)
    task.action_space.seed(0)
    inner = task.unwrapped
    return (
        "FetchPickAndPlace-v4",
        inner.model,
        inner.data,
        inner.n_substeps,
        task.reset,
        lambda: task.step(task.action_space.sample() / 10),
    )


def dm_control() -> tuple[str, Any, Any, int, Callable[[], object], Callable[[], object]]:
    """`manipulator`, `bring_ball`."""
    from dm_control import suite

    task = suite.load("manipulator", "bring_ball", {"random": 0})
    task.reset()
    low, high = task.action_spec().minimum, task.action_spec().maximum
    random = np.random.default_rng(0)
    substeps = round(task.control_timestep() / task.physics.timestep())
    model, data = task.physics.model.ptr, task.physics.data.ptr
    return (
        "manipulator bring_ball",
        model,
        data,
        substeps,
        task.reset,
        lambda: task.step(random.uniform(low, high) / 10),
    )


def share(
    model: Any, data: Any, substeps: int, reset: Callable[[], object], step: Callable[[], object], rounds: int
) -> float:
    """Time of `mj_step` alone over that of a step of the environment, from the same state with the same controls."""
    ratios = []
    for _ in range(WARM + rounds):
        reset()
        bare, sent, whole = copy.copy(data), [], 0.0
        for _ in range(PERIODS):
            began = time.process_time()
            step()
            whole += time.process_time() - began
            sent.append(data.ctrl.copy())
        began = time.process_time()
        for control in sent:
            bare.ctrl[:] = control
            mujoco.mj_step(model, bare, substeps)
        ratios.append((time.process_time() - began) / whole)
    return float(np.median(ratios[WARM:]))


def main(rounds: int) -> None:
    """Measure whatever is installed."""
    for package in (robosuite, gymnasium_robotics, dm_control):
        row = {"package": package.__name__, "mujoco": mujoco.__version__}
        try:
            name, model, data, substeps, reset, step = package()
            row |= {"version": metadata.version(package.__name__), "name": name, "substeps": substeps}
            row |= {"timestep": model.opt.timestep, "nv": model.nv}
            row["share"] = share(model, data, substeps, reset, step, rounds)
        except Exception as error:  # whatever is wrong with one of them is told in its row
            row["error"] = f"{type(error).__name__}: {error}"
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
