"""Print decisions per second of `learn.ppo` in MuJoCo Warp, on a GPU or a CPU, and the share of physics and learning.

    python -m tests.benchmarks.worlds.tensors cache/out/task/kl/lift_mustard_bottle/task/task.bundle --device cuda \
        --worlds 1 64 1024 4096 16384

Every row has one training: decisions are drawn at random by the untrained policy, as at the beginning of one, with
observations, rewards, verdicts and resets. The first rollout, in which kernels are compiled, does not count.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.learning import reproducible
from dextera_build.sim.training.tensors.worlds import TensorWorlds
from rules.learn.ppo.own_ppo import Learner, Settings, TwoSighted
from rules.learn.ppo.ppo_options import PpoOptions
from rules.learn.ppo.reinforcement import contract_of, limbs_of

HEADS = (
    "task",
    "device",
    "worlds",
    "decisions per second, with learning",
    "without",
    "control periods per second",
    "physics alone",
    "share of physics",
)


@dataclass(frozen=True)
class Found:
    """Seconds that a number of decisions take."""

    decisions: int
    every: int
    learning_s: float
    """With updates of the policy."""
    practice_s: float
    """Without: decisions, physics, observations, verdicts, rewards and resets."""
    physics_s: float
    """The control periods of as many decisions alone."""


def measured(bundle: TaskBundle, count: int, device: str, rollout: int, rounds: int) -> Found:
    """Measure one number of worlds."""
    options = PpoOptions()
    contract = contract_of(bundle, limbs_of(bundle, lambda: bundle.robot.limb_names[0]), options)
    worlds = TensorWorlds(bundle, contract, count, 0, pool=min(count, 64), device=device)
    batch = max(128, count * rollout // 32)
    settings = Settings(rollout=rollout, batch=batch, epochs=5, discount=options.discount)
    with reproducible.one_thread(), worlds.here():
        policy = TwoSighted(worlds, options.width, options.layers, options.spread).to(worlds.device)
        learner = Learner(worlds, policy, settings, options.rate)
        learner.seen = worlds.reset()
        random = torch.Generator(worlds.device)
        learner.update(learner.collect(random), random)
        practice_s = learning_s = physics_s = 0.0
        for _ in range(rounds):
            before = _now(device)
            made = learner.collect(random)
            between = _now(device)
            learner.update(made, random)
            after = _now(device)
            practice_s, learning_s = practice_s + between - before, learning_s + after - before
            physics_s += worlds.stepped(rollout * worlds.every, lambda: _now(device))
        worlds.check()
    return Found(rounds * rollout * count, worlds.every, learning_s, practice_s, physics_s)


def _now(device: str) -> float:
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter() if device == "cuda" else time.process_time()


def row(name: str, device: str, count: int, found: Found) -> str:
    """One number of worlds of one task."""
    periods = found.decisions * found.every
    cells = [
        f"| `{name}`",
        device,
        f"{count:,}",
        f"{found.decisions / found.learning_s:,.0f}",
        f"{found.decisions / found.practice_s:,.0f}",
        f"{periods / found.practice_s:,.0f}",
        f"{periods / found.physics_s:,.0f}",
        f"{100 * found.physics_s / found.practice_s:.0f} % |",
    ]
    return " | ".join(cells)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundles", nargs="+", type=Path, help="tasks, as `dxb build` writes them")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", choices=("cpu", "cuda"))
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 64, 1024, 4096, 16384], help="numbers of worlds")
    parser.add_argument("--rollout", type=int, default=8, help="decisions per world between two updates")
    parser.add_argument("--rounds", type=int, default=3, help="rollouts that are measured")
    arguments = parser.parse_args()
    card = torch.cuda.get_device_name() if arguments.device == "cuda" else "processor time of one core"
    print(f"{card}\n\n| {' | '.join(HEADS)} |\n{'|---' * len(HEADS)}|")
    for path in arguments.bundles:
        bundle = unpack(TaskBundle, path.read_bytes())
        for count in arguments.worlds:
            found = measured(bundle, count, arguments.device, arguments.rollout, arguments.rounds)
            print(row(bundle.task.name, arguments.device, count, found), flush=True)


if __name__ == "__main__":
    main()
