"""Print control periods per second of many worlds in one process, beside MuJoCo alone.

    python -m tests.benchmarks.worlds cache/out/task/kl/lift_mustard_bottle/task/task.bundle --worlds 1 4 16 64

All columns of a row are measured alternately in short rounds of the same run, in wall time and in processor time of
all threads; the median of the rounds counts. On a machine with other work, only shares in processor time say something.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from dextera_build.artifacts.packed import unpack
from dextera_build.artifacts.tasks.task import TaskBundle

from . import measure

HEADS = [
    *("task", "worlds", "periods per second", "`mj_step` alone", "share, wall time", "share, processor time"),
    *("`mujoco.rollout`", "as `learn.ppo`: periods per second", "of this, physics"),
]


def row(name: str, found: measure.Found) -> str:
    """One number of worlds of one task."""
    cells = [
        f"| `{name}`",
        f"{found.worlds:,}",
        f"{found.rate(found.ours):,.0f}",
        f"{found.rate(found.alone):,.0f}",
        f"{100 * found.share(found.ours, wall=True):.0f} %",
        f"{100 * found.share(found.ours):.0f} %",
        f"{found.rate(found.rollout):,.0f}",
        f"{found.rate(found.practice):,.0f}",
        f"{100 * found.practice_share:.0f} % |",
    ]
    return " | ".join(cells)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundles", nargs="+", type=Path, help="tasks, as `dxb build` writes them")
    parser.add_argument("--worlds", nargs="+", type=int, default=[1, 4, 16, 64], help="numbers of worlds")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads; default: all cores")
    parser.add_argument("--rounds", type=int, default=9, help="rounds of each measurement")
    arguments = parser.parse_args()
    print(f"{arguments.threads} threads\n\n| {' | '.join(HEADS)} |\n{'|---' * len(HEADS)}|")
    for path in arguments.bundles:
        bundle = unpack(TaskBundle, path.read_bytes())
        for count in arguments.worlds:
            print(
                row(bundle.task.name, measure.measured(bundle, count, arguments.threads, arguments.rounds)), flush=True
            )


if __name__ == "__main__":
    main()
