"""Print the tables of what stepping costs: tasks of dxb, and environments of other packages, beside MuJoCo alone.

    python -m tests.benchmarks.stepping cache/out/task/lift_blue_mug/task/task.bundle ... --peers PYTHON

`PYTHON` is an interpreter that has some of robosuite, gymnasium-robotics and dm_control; they need not be beside dxb.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
from pathlib import Path

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.sim.runtime.environment import Environment

from . import ours, peers

SIZE = (320, 240)
"""Width and height of pictures [px]."""


def row(name: str, bundle: TaskBundle, rounds: int) -> str:
    """One task."""
    environment = Environment(bundle)
    alone = ours.stepped(bundle, rounds)
    two = ours.side_by_side(bundle, rounds, 2) if len(os.sched_getaffinity(0)) > 1 else []
    middle, late = ours.resets(bundle, 10 * rounds)
    model = environment.model
    return " | ".join(
        [
            f"| `{name}`",
            f"{model.nv}, {environment.substeps} x {1e3 * model.opt.timestep:g} ms",
            f"{100 * alone.runtime:.0f} %",
            f"{100 * alone.share:.0f} %",
            ", ".join(f"{100 * each.share:.0f} %" for each in two) or "-",
            f"{alone.real_time:.0f}",
            f"{1e3 * middle:.1f}, {1e3 * late:.1f}",
            f"{ours.pictures(bundle, rounds, SIZE):.2f} |",
        ]
    )


def peer_row(found: dict[str, object]) -> str:
    """One environment of another package."""
    if "error" in found:
        return f"| {found['package']} | does not run with MuJoCo {found['mujoco']}: {found['error']} | |"
    step = f"{found['nv']}, {found['substeps']} x {1e3 * float(str(found['timestep'])):g} ms"
    name = f"{found['package']} {found['version']}, {found['name']}, MuJoCo {found['mujoco']}"
    return f"| {name} | {step} | {100 * float(str(found['share'])):.0f} % |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundles", nargs="+", type=Path, help="tasks, as `dxb build` writes them")
    parser.add_argument("--peers", type=Path, help="an interpreter that has other packages")
    parser.add_argument("--rounds", type=int, default=40, help="rounds of each measurement")
    arguments = parser.parse_args()
    heads = [
        "task",
        "degrees of freedom, substeps",
        "observations, verdict",
        "and reward",
        "two processes",
        "x real time",
        "reset: median, p99 [ms]",
        "picture / MuJoCo's",
    ]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for path in arguments.bundles:
        # `dxb build` writes to `out/RECIPE/task`.
        name = path.resolve().parents[1].as_posix().rpartition("/out/")[2]
        print(row(name, unpack(TaskBundle, path.read_bytes()), arguments.rounds), flush=True)
    if arguments.peers:
        print("\n| environment | degrees of freedom, substeps | of `mj_step` |\n|---|---|---|", flush=True)
        command = [str(arguments.peers), str(peers.__file__), str(arguments.rounds)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        for line in done.stdout.splitlines():
            if line.startswith("{"):
                print(peer_row(json.loads(line)), flush=True)


if __name__ == "__main__":
    main()
