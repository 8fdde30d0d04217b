"""Measures `dxb run` on a simulated robot over DDS, each in a process of its own.

`python -m tests.benchmarks.robot_runs PROJECT TASK POLICY --trials 10`, in which the task and the policy are built.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.statistics import wilson

DXB = (str(Path(sys.executable).parent / "dxb"),)
KINDS = {"in every period": (), "asynchronous": ("--asynchronous",)}


def run(project: Path, task: str, policy: str, seed: int, more: Sequence[str]) -> dict[str, Any]:
    """What one run tells, at the start of a seed."""
    command = [*DXB, "robot", "simulate", task, "--seed", str(seed)]
    with subprocess.Popen(command, cwd=project, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as robot:
        assert robot.stderr is not None
        while "simulated robot" not in (line := robot.stderr.readline()):
            assert line, "the robot ended"
        try:
            out = project / "runs" / f"{'-'.join(['run', *more])}-{seed}.mcap"
            command = [*DXB, "run", task, "--policy", policy, "--json", "--out", str(out), *more]
            done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
        finally:
            robot.send_signal(signal.SIGINT)
            robot.communicate()
    assert done.stdout, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def row(name: str, ran: Sequence[dict[str, Any]]) -> str:
    """A row of the table, from the runs of one kind."""

    def median(key: str) -> str:
        return f"{np.median([each[key] for each in ran]):.1f}"

    won, steps = sum(each["success"] for each in ran), sum(each["steps"] for each in ran)
    low, high = wilson(won, len(ran))
    late = sum(each["missed_periods"] for each in ran)
    cells = [
        name,
        f"{won} of {len(ran)} [{100 * low:.0f}, {100 * high:.0f}] %",
        f"{late} of {steps}",
        f"{median('delay_ms_p50')}, {median('delay_ms_p99')}",
        f"{median('jitter_ms_p50')}, {median('jitter_ms_p99')}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("task")
    parser.add_argument("policy")
    parser.add_argument("--trials", type=int, default=10)
    args = parser.parse_args()
    print("| policy is asked | success | late periods | delay p50, p99 [ms] | jitter p50, p99 [ms] |")
    print("|---|---|---|---|---|")
    for name, more in KINDS.items():
        ran = [run(args.project, args.task, args.policy, seed, more) for seed in range(args.trials)]
        print(row(name, ran), flush=True)


if __name__ == "__main__":
    main()
