"""What the tracker costs a run: the same starts with exact poses, and with those of the tracker on noisy pictures.

`python -m tests.benchmarks.robot_tracker PROJECT TASK REFERENCE CELL POLICY --trials 10`, all of which are built.
Everything runs in one process and in virtual time, so that a busy machine changes nothing; a frame takes the tracker as
long as the cell says.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.cell import Cell
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying.driving import quantiles
from dextera_build.project.project import find
from dextera_build.running import called
from dextera_build.session import Session
from dextera_build.statistics import wilson
from tests.deploying.robots import Rig
from tests.deploying.watched import Seen, watched
from tests.policy import policies

LISTEN_S = 3.0
"""Time for which the checks before a run listen [s]."""


def error_m(rig: Seen) -> float:
    """Distance of the task's object from where the tracker has it [m]; not a number while it is lost."""
    name = rig.bundle.task.object
    last = rig.cell.objects[name].last
    truth = rig.robot.environment.measure().objects[list(rig.bundle.objects).index(name)]
    return float("nan") if last is None else float(np.linalg.norm(last.value[:3] - truth[:3]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    for name in ("task", "reference", "cell", "policy"):
        parser.add_argument(name)
    parser.add_argument("--trials", type=int, default=10)
    args = parser.parse_args()
    project = find(args.project)

    def made(address: str, kind: type[Any]) -> Any:
        recipe, _, node = address.partition(":")
        found = Session(project, recipe, last=True).artifact(node)
        assert isinstance(found, kind), address
        return found

    with called.shown(project.library):
        twin, world = made(args.task, TaskBundle), made(args.reference, TaskBundle)
        cell, checkpoint = made(args.cell, Cell), made(args.policy, Checkpoint)
        policy = policies.load(checkpoint, twin)
        needed = tuple(channel.name for channel in checkpoint.contract.inputs)
        print("| seed | exact poses | tracker: true state, measured | why it ended | error before, after [mm] |")
        print("|---|---|---|---|---|", flush=True)
        rows = []
        for seed in range(args.trials):
            plain = Rig(bundle=world, seed=seed, needed=needed)
            plain.sleep(LISTEN_S)
            plain.drive(policy, twin.task.timeout_s)
            plain.sleep(1.0)
            with watched(world, twin, cell, seed=seed, needed=needed) as rig:
                rig.sleep(LISTEN_S)
                before = error_m(rig)
                ran = rig.drive(policy, twin.task.timeout_s)
                rig.sleep(1.0)
                rows.append((plain.robot.success, rig.robot.success, ran.success, ran.faulty))
                errors = f"{1000 * before:.1f}, {1000 * error_m(rig):.1f}"
                print(
                    f"| {seed} | {rows[-1][0]} | {rows[-1][1]}, {ran.success} | {ran.reason} | {errors} |", flush=True
                )
                print(f"  {quantiles('delay', ran.delays_s)}", flush=True)
    for name, column in (("exact poses", 0), ("tracker", 1)):
        won = sum(row[column] for row in rows)
        low, high = wilson(won, len(rows))
        print(f"{name}: {won} of {len(rows)} [{100 * low:.0f}, {100 * high:.0f}] %")
    print(f"stopped: {sum(row[3] for row in rows)}; verdicts agree: {sum(row[1] == row[2] for row in rows)}")


if __name__ == "__main__":
    main()
