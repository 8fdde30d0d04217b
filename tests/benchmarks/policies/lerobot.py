"""Train ACT and Diffusion Policy of dxb and of LeRobot on the same states, run all from the same starts, print a table.

    make readers
    python -m tests.benchmarks.policies.lerobot --steps 2000 --trials 50
    python -m tests.benchmarks.policies.lerobot --task task/close_laptop --steps 20000 --batch 64

Without `--task`, a gantry of five joints lifts a box; with it, task and episodes are nodes of a built recipe. Widths,
chunks, horizons, batches and learning rates are the same, as far as both have them; the rest are the defaults of each:
LeRobot's ACT has another mask of the loss, learning rates that are constant (ACT) or warm up (Diffusion), and no
average of weights. Seconds pass on the clock: LeRobot trains in a process of its own, whose start counts once and is
taken off by a second training of one step.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.policies import load
from dextera_build.testing import RuleRunner
from tests import readers
from tests.benchmarks.policies.__main__ import chosen, row
from tests.policy import policies

HEAD = "| | weights [bytes] | s per 1,000 steps | success | ms per action |\n|---|---|---|---|---|"
OWN: dict[str, dict[str, Any]] = {
    "act": {"chunk": 20, "every": 20, "width": 96, "heads": 4, "encoder_layers": 2, "decoder_layers": 1, "latent": 8},
    "diffusion": {"width": 64, "levels": 3, "horizon": 16, "history": 2, "every": 8, "denoisings": 10},
}
THEIRS: dict[str, dict[str, Any]] = {
    "act": {
        "chunk_size": 20,
        "n_action_steps": 20,
        "dim_model": 96,
        "n_heads": 4,
        "dim_feedforward": 192,
        "n_encoder_layers": 2,
        "n_decoder_layers": 1,
        "n_vae_encoder_layers": 1,
        "latent_dim": 8,
    },
    "diffusion": {
        "down_dims": [64, 128, 256],
        "horizon": 16,
        "n_obs_steps": 2,
        "n_action_steps": 8,
        "noise_scheduler_type": "DDIM",
        "num_inference_steps": 10,
    },
}


def timed(
    runner: RuleRunner, rule: str, steps: int, options: dict[str, Any], **inputs: Any
) -> tuple[Checkpoint, float]:
    """A policy, and seconds per 1,000 steps."""

    def trained(count: int) -> tuple[Checkpoint, float]:
        before = time.perf_counter()
        made = runner.run(rule, options={**options, "steps": count}, **inputs)
        assert isinstance(made, Checkpoint)
        return made, time.perf_counter() - before

    _, start = trained(1)  # imports, and what each training does once
    _, start = trained(1)
    made, whole = trained(steps)
    return made, 1000 * (whole - start) / max(1, steps - 1)


def compare(
    bundle: TaskBundle, episodes: Episodes, kind: str, given: dict[str, Any], trials: int, folder: Path
) -> list[str]:
    """The rows of one kind of policy; the current folder must be `folder`, a project with LeRobot's environment."""
    runner, environment = RuleRunner(folder / "scratch", project=folder), Environment(bundle)
    shared, steps = {name: given[name] for name in ("batch", "seed")}, given["steps"]
    own = OWN[kind] | shared | {"rate": given["rate"], "objects": "all", "held_out": 0.0}
    made, seconds = timed(runner, f"learn.{kind}", steps, own, bundle=bundle, episodes=episodes)
    rows = [row(f"dxb `learn.{kind}`", len(made.weights), seconds, policies.load(made, bundle), environment, trials)]
    data = runner.run("demonstrate.lerobot", bundle=bundle, episodes=episodes)
    theirs = shared | {"type": kind, "policy": THEIRS[kind] | {"optimizer_lr": given["rate"]}, "workers": 0}
    made, seconds = timed(runner, "learn.lerobot", steps, theirs, bundle=bundle, data=data)
    name = f"LeRobot {made.contract.settings['version']} {kind}"
    policy = load(policies.runner("lerobot"), made, bundle)
    return [*rows, row(name, len(made.weights), seconds, policy, environment, trials)]


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--task", help="a recipe with nodes `task` and `episodes`, of joint targets")
    options.add_argument("--demonstrations", type=int, default=20, help="of the gantry")
    options.add_argument("--trials", type=int, default=50)
    options.add_argument("--kinds", nargs="+", choices=list(OWN), default=list(OWN))
    for name, value in {"steps": 2000, "batch": 64, "rate": 1e-3, "seed": 0}.items():
        options.add_argument(f"--{name}", type=type(value), default=value)
    given = options.parse_args()
    bundle, episodes = chosen(given.task, given.demonstrations)
    print(HEAD)
    with TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "scratch").mkdir()
        readers.installed(folder, "lerobot", "lerobot-0.4")
        os.chdir(folder)
        for kind in given.kinds:
            print(*compare(bundle, episodes, kind, vars(given), given.trials, folder), sep="\n", flush=True)


if __name__ == "__main__":
    main()
