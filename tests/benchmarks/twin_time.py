"""Print the processor time of twins of captures, from an empty store, by stage.

OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MUJOCO_GL=egl python -m tests.benchmarks.twin_time FOLDER...

A folder is a capture of `twin/tabletop`. The time is that of all processes, user and system; it grows when other work
shares the caches of the processor, so the program is for a quiet machine.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

REPO = Path(__file__).parents[2]
DXB = [sys.executable, "-m", "dextera_build"]
STAGES = {
    "meshes": "factorize.mesh",
    "background": "background",
    "overlay": "evaluate",
    "other nodes": "",
}
"""Column -> beginning of the names of its rules; the first that fits counts."""
REST = "plan, start, export"
"""Column of what no node is charged with."""


def spent(command: Sequence[str], environment: Mapping[str, str]) -> float:
    """Processor time of a command and of all processes that it waited for [s].

    Raises:
        SystemExit: It failed.
    """
    process = subprocess.Popen(command, cwd=REPO, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"exit status {process.returncode}: {' '.join(command)}")
    return used.ru_utime + used.ru_stime


def shares(events: Sequence[Mapping[str, Any]], total: float) -> dict[str, float]:
    """Column -> processor time [s].

    Args:
        events: Those of a run, as `dxb log RUN --json` prints them.
        total: All of its processor time [s].
    """
    rules = {event["node"]: event["rule"] for event in events if event["event"] == "node_started"}
    found = dict.fromkeys(STAGES, 0.0)
    for event in events:
        if event["event"] == "node_finished" and event["node"] in rules:
            rule = rules[event["node"]]
            column = next(name for name, begins in STAGES.items() if rule.startswith(begins))
            found[column] += event["usage"].get("cpu_seconds", 0.0)
    return {**found, REST: total - sum(found.values())}


def built(folder: Path, jobs: int | None) -> tuple[int, float, dict[str, float]]:
    """Number of objects, processor time [s] and its shares of one build from an empty store."""
    with tempfile.TemporaryDirectory() as store:
        environment = {**os.environ, "DXB_CACHE": store, "DXB_CONSOLE": "none"}
        command = [*DXB, "build", "twin/tabletop", "--input", f"capture={folder.resolve()}"]
        total = spent(command + (["--jobs", str(jobs)] if jobs else []), environment)
        log = subprocess.run(
            [*DXB, "log", "0001", "--json"], cwd=REPO, env=environment, capture_output=True, check=True
        )
        events = json.loads(log.stdout)["rows"]
        objects = sum(event["event"] == "node_started" and event["rule"] == "factorize.mesh" for event in events)
        return objects, total, shares(events, total)


def row(folder: Path, runs: int, jobs: int | None) -> str:
    """The medians of one capture."""
    made = [built(folder, jobs) for _ in range(runs)]
    columns = [statistics.median(each[2][column] for each in made) for column in (*STAGES, REST)]
    total = statistics.median(each[1] for each in made)
    return f"| `{folder.name}` | {made[0][0]} | {total:.1f} | " + " | ".join(f"{value:.1f}" for value in columns) + " |"


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folders", nargs="+", type=Path, help="captures")
    options.add_argument("--runs", type=int, default=5, help="builds of each, of which medians are printed")
    options.add_argument("--jobs", type=int, help="as of `dxb build`")
    given = options.parse_args()
    heads = ["capture", "objects", "all [s]", *(f"{column} [s]" for column in (*STAGES, REST))]
    print("| " + " | ".join(heads) + " |", "| " + " | ".join("---" for _ in heads) + " |", sep="\n")
    for folder in given.folders:
        print(row(folder, given.runs, given.jobs), flush=True)


if __name__ == "__main__":
    main()
