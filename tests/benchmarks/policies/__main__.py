"""Train BC-RNN-GMM of dxb and of robomimic on the same episodes, run both from the same starts, and print a table.

    make readers
    python -m tests.benchmarks.policies --steps 2000 --trials 50
    python -m tests.benchmarks.policies --task task/close_laptop --steps 20000 --hidden 400 --batch 100 --rate 1e-4

Without `--task`, a gantry of five joints lifts a box; with it, task and episodes are nodes of a built recipe. Both see
joints, poses and joints of all objects, and the goal. That of dxb normalises them and its actions by mean and standard
deviation; robomimic 0.3 cannot normalise observations in sequences, and demands actions scaled to -1..1. Its learning
rate is constant, that of dxb decays. Seconds are processor seconds of one thread.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dextera_build.api import Project
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy.layout import of_bundle
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import Acting, closed_loop
from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import Rate
from dextera_build.testing import RuleRunner
from tests import gantry, task_bundles
from tests.benchmarks.policies.peer import Peer
from tests.policy.policies import load

HEAD = "| | weights | processor s per 1,000 steps | success | ms per action |\n|---|---|---|---|---|"
DEFAULTS = {"steps": 2000, "batch": 64, "rate": 1e-3, "hidden": 128, "layers": 2, "horizon": 10, "modes": 5, "seed": 0}
"""Options that both are given."""


class Timed:
    """A policy whose actions are timed, in milliseconds that pass on the clock."""

    def __init__(self, policy: Acting) -> None:
        self._policy = policy
        self.taken: list[float] = []

    def reset(self) -> None:
        """Begin an episode."""
        self._policy.reset()

    def act(self, observation: Any) -> np.ndarray:
        """The policy's action."""
        before = time.perf_counter()
        action = self._policy.act(observation)
        self.taken.append(1e3 * (time.perf_counter() - before))
        return action


def row(name: str, numbers: int, per_thousand_s: float, policy: Acting, environment: Environment, trials: int) -> str:
    """Run a policy, and describe it."""
    timed, succeeded = Timed(policy), 0
    for number in range(trials):
        succeeded += closed_loop(environment, timed, environment.draw(seed_of("trial", 0, number))).success
    rate = Rate(succeeded, trials)
    return f"| {name} | {numbers:,} | {per_thousand_s:.1f} | {rate} | {np.median(timed.taken):.2f} |"


def own(
    runner: RuleRunner, bundle: TaskBundle, episodes: Episodes, options: dict[str, Any]
) -> tuple[Checkpoint, float]:
    """The policy of `learn.bc_rnn`, and processor seconds per 1,000 steps."""
    more = {"objects": "all", "held_out": 0.0, "decay": 0.0}

    def trained(steps: int) -> tuple[Checkpoint, float]:
        before = time.process_time()
        made = runner.run("learn.bc_rnn", bundle=bundle, episodes=episodes, options={**options, **more, "steps": steps})
        assert isinstance(made, Checkpoint)
        return made, time.process_time() - before

    _, start = trained(1)  # imports, and what each training does once
    _, start = trained(1)
    made, whole = trained(options["steps"])
    return made, 1000 * (whole - start) / max(1, options["steps"] - 1)


def exported(runner: RuleRunner, bundle: TaskBundle, episodes: Episodes, folder: Path) -> Path:
    """The file for robomimic, in which no episode is held out."""
    made = runner.run("demonstrate.robomimic", bundle=bundle, episodes=episodes, options={"valid_share": 0.0})
    assert isinstance(made, Folder)
    trees.write(made.files, folder)
    return folder / "demo.hdf5"


def compare(bundle: TaskBundle, episodes: Episodes, options: dict[str, Any], trials: int, folder: Path) -> list[str]:
    """The rows of the table."""
    from dextera_build.learning import weights  # loads torch, and tests that are collected import this file

    runner, environment = RuleRunner(folder), Environment(bundle)
    checkpoint, seconds = own(runner, bundle, episodes, options)
    count = sum(each.numel() for each in weights.from_bytes(checkpoint.weights).values())
    rows = [row("dxb `learn.bc_rnn`", count, seconds, load(checkpoint, bundle), environment, trials)]
    setting = options | {"file": str(exported(runner, bundle, episodes, folder / "robomimic"))}
    with Peer("robomimic", setting, of_bundle(bundle), folder) as peer:
        facts, name = peer.facts, f"robomimic {peer.facts['version']} BC-RNN-GMM"
        seconds = 1000 * facts["seconds"] / options["steps"]
        rows.append(row(name, facts["numbers"], seconds, peer, environment, trials))
    return rows


def chosen(task: str | None, demonstrations: int) -> tuple[TaskBundle, Episodes]:
    """The task and its demonstrations."""
    if task is None:
        bundle = task_bundles.lift(reset=gantry.RESET)
        return bundle, gantry.demonstrations(bundle, demonstrations)
    project = Project.find()
    bundle, episodes = (project.get(f"{task}:{node}") for node in ("task", "episodes"))
    assert isinstance(bundle, TaskBundle)
    assert isinstance(episodes, Episodes)
    return bundle, episodes


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--task", help="a recipe with nodes `task` and `episodes`, of joint targets")
    options.add_argument("--demonstrations", type=int, default=20, help="of the gantry")
    options.add_argument("--trials", type=int, default=50)
    for name, value in DEFAULTS.items():
        options.add_argument(f"--{name}", type=type(value), default=value)
    options.add_argument("--least-std", type=float, default=0.1, help="of dxb; robomimic's is 1e-4 of half the limits")
    given = options.parse_args()
    bundle, episodes = chosen(given.task, given.demonstrations)
    sizes = {name: getattr(given, name) for name in (*DEFAULTS, "least_std")}
    with TemporaryDirectory() as folder:
        print(HEAD, *compare(bundle, episodes, sizes, given.trials, Path(folder)), sep="\n")


if __name__ == "__main__":
    main()
