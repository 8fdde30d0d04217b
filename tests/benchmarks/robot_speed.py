"""Why a policy fares otherwise in `dxb run` than in `evaluate.rollouts`: the same starts, one difference after another.

`python -m tests.benchmarks.robot_speed PROJECT TASK POLICY --trials 10`, in which the task and the policy are built.
Everything runs in one process and in virtual time, so that a busy machine changes nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying.ahead import Ahead, Chunked
from dextera_build.deploying.cell import GUARDED, Safety
from dextera_build.deploying.continuing import Continuing
from dextera_build.policy.cell import Guard
from dextera_build.policy.observation import Frames, Measurement
from dextera_build.policy.running import Policy
from dextera_build.project.project import find
from dextera_build.running import called
from dextera_build.session import Session
from dextera_build.sim.runtime import policies as loading
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import wilson
from tests.deploying.robots import Rig
from tests.deploying.test_ahead import Slow
from tests.policy import policies

NEWEST = -5.0
"""Decay of weights at which answers but the newest have none."""
Trial = Callable[[int], bool]
"""Whether the policy succeeds from the start of a seed, by the true state."""


class Guarded:
    """A simulator whose targets pass the guard of `dxb run`."""

    def __init__(self, environment: Environment, safety: Safety) -> None:
        self._environment = environment
        rate, robot = environment.task.control_hz, environment.bundle.robot
        self._guard = Guard(safety.limits, robot, rate, lambda _: np.zeros((0, 3)), safety.ramp_s)

    def begin(self, start: Any) -> str:
        """Begin an episode."""
        self._environment.begin(start)
        self._guard.begin(self._environment.previous_action)
        return ""

    def measure(self, frames: Frames | None = None) -> Measurement:
        """Exact."""
        return self._environment.measure(frames)

    def send(self, targets: np.ndarray) -> np.ndarray:
        """Within the limits."""
        return self._environment.send(self._guard.passed(targets, np.zeros((0, 3)), 0.0))


def rollout(bundle: TaskBundle, policy: Policy, safety: Safety | None) -> Trial:
    """As `evaluate.rollouts` does, perhaps with a guard."""
    environment = Environment(bundle)
    cell = None if safety is None else Guarded(environment, safety)

    def trial(seed: int) -> bool:
        return closed_loop(environment, policy, environment.draw(seed), cell=cell).success

    return trial


def run(
    bundle: TaskBundle,
    policy: Policy,
    safety: Safety,
    answer_s: float | None = None,
    forget: float | None = None,
    continuing: Continuing | None = None,
) -> Trial:
    """As `dxb run` does on a simulated robot; with `answer_s`, asynchronously, and every answer takes as long [s]."""
    needed = tuple(channel.name for channel in policy.contract.inputs)

    def trial(seed: int) -> bool:
        rig = Rig(bundle=bundle, seed=seed, needed=needed, safety=safety)
        acting: Any = policy
        if answer_s is not None:
            chunked = Chunked.of(policy.contract)
            acting = Ahead(
                policy,
                lambda: rig.cell.previous_action,
                rate_hz=rig.cell.rate_hz,
                chunked=replace(chunked, forget=chunked.forget if forget is None else forget),
                answer_s=safety.answer_s,
                now=lambda: rig.time,
                worker=Slow(rig, [answer_s]),
                continuing=continuing,
            )
        rig.sleep(3.0)  # as long as the checks before a run listen
        rig.drive(acting, bundle.task.timeout_s)
        rig.sleep(1.0)  # the run ends as soon as measurements show success, the true state may follow
        return rig.robot.success

    return trial


def speeds(fraction: float, ramp_s: float) -> Safety:
    """The limits of `dxb run --speed FRACTION --ramp S`."""
    limits: Limits = GUARDED.model_copy(update={"speed": fraction})
    return Safety(limits=limits, ramp_s=ramp_s)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("task")
    parser.add_argument("policy")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument(
        "--of-trials", action="store_true", help="the starts of evaluate.rollouts, not those of dxb robot"
    )
    parser.add_argument("--only", default="", help="the ways with this in their names")
    args = parser.parse_args()
    seeds = [seed_of("trial", 0, number) if args.of_trials else number for number in range(args.trials)]
    project = find(args.project)
    with called.shown(project.library):
        bundle, checkpoint = (
            Session(project, recipe, last=True).artifact(node)
            for recipe, _, node in (each.partition(":") for each in (args.task, args.policy))
        )
        assert isinstance(bundle, TaskBundle)
        assert isinstance(checkpoint, Checkpoint)
        policy = policies.load(checkpoint, bundle)
        continuing = Continuing(policies.runner(checkpoint.contract.algorithm))
        half, full = speeds(0.5, 1.5), speeds(1.0, 0.0)
        trials = {
            "`evaluate.rollouts`": rollout(bundle, policy, None),
            "the same, at half speed with a ramp of 1.5 s": rollout(bundle, policy, half),
            "`dxb run`": run(bundle, policy, half),
            "`dxb run --speed 1 --ramp 0`": run(bundle, policy, full),
            "`dxb run --asynchronous`, answers in 20 ms": run(bundle, policy, half, 0.02),
            "the same with the newest answer alone": run(bundle, policy, half, 0.02, NEWEST),
            "`dxb run --asynchronous`, answers in 100 ms": run(bundle, policy, half, 0.1),
        }
        if checkpoint.contract.algorithm == "diffusion":
            joined = loading.load(continuing, checkpoint, bundle)
            trials |= {
                "`dxb run --asynchronous`, answers in 200 ms": run(bundle, policy, half, 0.2),
                "`dxb run --real-time-chunking`, answers in 200 ms": run(bundle, joined, half, 0.2, None, continuing),
            }
        trials = {name: each for name, each in trials.items() if args.only in name}
        print("| way | success | starts |\n|---|---|---|")
        for name, trial in trials.items():
            won = [trial(seed) for seed in seeds]
            low, high = wilson(sum(won), len(won))
            marks = "".join("x" if each else "." for each in won)
            print(
                f"| {name} | {sum(won)} of {len(won)} [{100 * low:.0f}, {100 * high:.0f}] % | `{marks}` |", flush=True
            )


if __name__ == "__main__":
    main()
