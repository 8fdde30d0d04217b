"""Measures `dxb run` on a simulated robot over DDS, each in a process of its own: policies, and replays of episodes.

`python -m tests.benchmarks.robot_runs PROJECT OUT RECIPE... --policy NODE --trials 20`, all of which was built. A trial
that OUT holds is kept, so that an interrupted table continues; the table has every trial of OUT. Trials of a policy
begin where those of `evaluate.rollouts` begin, and replays where their episodes began.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.sim.runtime.seeds import seed_of
from dextera_build.statistics import wilson

DXB = (str(Path(sys.executable).parent / "dxb"),)
AS_REPLAYED = ("--speed", "1", "--ramp", "0")
"""Options with which the targets of an episode are sent as they are, within the limits of the joints."""
AFTER_S = 1.0
"""Time from the end of a run to that of its robot [s], in which the true state may still succeed."""


@dataclass(frozen=True)
class Way:
    """What is run, how, and where."""

    recipe: str
    """Recipe of all nodes."""
    nodes: dict[str, str]
    """`task`, `world`, `cell`, and what acts, `policy` or `replay` -> node."""
    names: str
    """Node with the robot's names; empty: the defaults."""
    domain: str
    """Domain of DDS."""
    options: tuple[str, ...]
    """Further options of `dxb run`."""

    @property
    def name(self) -> str:
        """Its name in the table."""
        acts = self.nodes.get("policy") or f"replay of {self.nodes['replay']}"
        return " ".join([acts, *(["tracked"] if "cell" in self.nodes else []), *self.options])

    def address(self, node: str) -> str:
        """A node as it is typed; one of another recipe is stated as such."""
        found = self.nodes[node]
        return found if ":" in found else f"{self.recipe}:{found}"

    def shared(self) -> list[str]:
        """Options of both programs."""
        names = ["--names", self.names] if self.names else []
        cell = ["--cell", self.address("cell")] if "cell" in self.nodes else []
        return ["--domain", self.domain, "--json", *names, *cell]

    def robot(self, number: int) -> list[str]:
        """The robot of a trial."""
        command = [*DXB, "robot", "simulate", self.address("world"), *self.shared()]
        if "replay" in self.nodes:
            return [*command, "--start", self.address("replay"), "--episode", str(number), "--seed", str(number)]
        return [*command, "--seed", str(seed_of("trial", 0, number))]

    def run(self, number: int, out: Path) -> list[str]:
        """The run of a trial."""
        command = [*DXB, "run", self.address("task"), *self.shared(), "--out", str(out), *self.options]
        if "replay" in self.nodes:
            return [*command, "--replay", self.address("replay"), "--episode", str(number), *AS_REPLAYED]
        return [*command, "--policy", self.address("policy")]


def trial(project: Path, way: Way, number: int, out: Path) -> dict[str, Any] | None:
    """What a run and its robot tell; None if the run was refused, which is no trial."""
    with subprocess.Popen(
        way.robot(number), cwd=project, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as robot:
        assert robot.stderr is not None
        said = list[str]()
        while "simulated robot" not in (line := robot.stderr.readline()):
            assert line, "the robot ended: " + "".join(said)
            said.append(line)
        try:
            done = subprocess.run(way.run(number, out), cwd=project, capture_output=True, text=True, check=False)
            time.sleep(AFTER_S)
        finally:
            robot.send_signal(signal.SIGINT)
            told, _ = robot.communicate()
    if not done.stdout:
        print(f"{way.recipe} {number} was refused: {done.stderr}", file=sys.stderr, flush=True)
        return None
    about = {"recipe": way.recipe, "way": way.name, "number": number, "code": done.returncode}
    return about | {"run": json.loads(done.stdout), "robot": json.loads(told)}


def recorded(project: Path, way: Way, trials: int, out: Path) -> None:
    """Make the trials of a way that a folder lacks."""
    folder = out / f"{way.recipe} {way.name}".replace("/", "-").replace(" ", "_")
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(trials):
        kept, bag = folder / f"{number}.json", folder / f"{number}.mcap"
        if kept.exists():
            continue
        bag.unlink(missing_ok=True)  # of a trial that was interrupted
        if (found := trial(project, way, number, bag)) is not None:
            fresh = kept.with_suffix(".part")
            fresh.write_text(json.dumps(found))
            fresh.rename(kept)
            print(f"{way.recipe} {number}: {found['robot']['success']}, {found['run']['reason']}", file=sys.stderr)


def rows(out: Path) -> Iterator[str]:
    """The table of all trials in a folder."""
    found = [json.loads(path.read_text()) for path in sorted(out.glob("*/*.json"))]
    measured = "success | by measurements | stopped | late periods | delay p50, p99 [ms] | jitter p50, p99 [ms]"
    yield f"| task | what acts | {measured} |"
    yield "|---|---|---|---|---|---|---|---|"
    for recipe, way in sorted({(each["recipe"], each["way"]) for each in found}):
        yield row(recipe, way, [each for each in found if (each["recipe"], each["way"]) == (recipe, way)])


def row(recipe: str, way: str, found: Sequence[dict[str, Any]]) -> str:
    """A row of the table, from the trials of one way."""
    ran = [each["run"] for each in found]

    def median(key: str) -> str:
        known = [each[key] for each in ran if each[key] is not None]
        return f"{np.median(known):.1f}" if known else "-"

    won = sum(each["robot"]["success"] for each in found)
    low, high = wilson(won, len(found))
    cells = [
        recipe,
        way,
        f"{won} of {len(found)} [{100 * low:.0f}, {100 * high:.0f}] %",
        f"{sum(bool(each['success']) for each in ran)} of {len(found)}",
        f"{sum(each['code'] != 0 for each in found)}",
        f"{sum(each['missed_periods'] for each in ran)} of {sum(each['steps'] for each in ran)}",
        f"{median('delay_ms_p50')}, {median('delay_ms_p99')}",
        f"{median('jitter_ms_p50')}, {median('jitter_ms_p99')}",
    ]
    return "| " + " | ".join(cells) + " |"


def main(given: Sequence[str] | None = None) -> None:
    """Make what lacks, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("recipes", nargs="*", metavar="RECIPE")
    parser.add_argument("--policy", action="append", default=[], metavar="NODE")
    parser.add_argument("--replay", action="append", default=[], metavar="NODE", help="episodes in the twin")
    parser.add_argument("--task", default="set/pair/believed", metavar="NODE", help="the task in the twin")
    parser.add_argument("--world", default="set/pair/reference", metavar="NODE", help="the task in the robot's world")
    parser.add_argument("--cell", default="", metavar="NODE", help="find objects by the tracker, set/pair/cell")
    parser.add_argument("--names", default="", metavar="RECIPE:NODE")
    parser.add_argument("--option", action="append", default=[], help="of `dxb run`, `--option=--asynchronous`")
    parser.add_argument("--domain", default="0")
    parser.add_argument("--trials", type=int, default=20)
    args = parser.parse_args(given)
    acts = [("policy", node) for node in args.policy] + [("replay", node) for node in args.replay]
    nodes = {"task": args.task, "world": args.world} | ({"cell": args.cell} if args.cell else {})
    for recipe in args.recipes:
        for what, node in acts:
            way = Way(recipe, {**nodes, what: node}, args.names, args.domain, tuple(args.option))
            recorded(args.project, way, args.trials, args.out.resolve())
    print("\n".join(rows(args.out)))


if __name__ == "__main__":
    main()
