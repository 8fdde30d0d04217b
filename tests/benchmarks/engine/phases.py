"""The phases that every tool goes through, each checked: exit code, what was built, how many nodes ran."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.benchmarks.engine import measure
from tests.benchmarks.engine.dags import Dag, evaluate, write_leaf
from tests.benchmarks.engine.measure import Cost
from tests.benchmarks.engine.tools.tool import Tool

PHASES = {
    "cold": "nothing is built",
    "no-op": "nothing changed",
    "leaf": "one leaf changed",
    "back": "the leaf changed back to what it was a build ago",
    "comment": "a line of one leaf that no node reads changed",
    "touched": "one leaf has a new time stamp",
    "deleted": "all outputs deleted, what the tool remembers kept",
}
LEAF = "l0"


@dataclass(frozen=True)
class Limits:
    """How long things may take."""

    cell: float = 120.0
    """One build [s]."""
    repeats: int = 5
    """Builds of which a phase shows the quickest."""
    budget: float = 10.0
    """After so long no further build of a phase begins [s]."""


@dataclass(frozen=True)
class Cell:
    """One tool in one phase of one graph."""

    tool: str
    shape: str
    size: int
    phase: str
    state: str
    """`ok`, `slow` (over the limit), `failed`, `wrong` or `skipped`."""
    seconds: float | None = None
    cpu: float | None = None
    rss_mib: float | None = None
    ran: int | None = None
    """Nodes that ran or whose output was written."""
    why: str = ""

    def to_json(self) -> dict[str, object]:
        """Plain data."""
        return asdict(self)


@dataclass
class Course:
    """One tool on one graph: a project folder, and what its leaves say now."""

    tool: Tool
    dag: Dag
    folder: Path
    limits: Limits
    leaves: dict[str, int] = field(default_factory=dict)
    comments: int = 0

    def __post_init__(self) -> None:
        self.leaves = dict(self.dag.leaves)

    def run(self, phases: list[str]) -> Iterator[Cell]:
        """Measure the phases one after the other; after one that did not end well the rest is skipped."""
        (self.folder / "leaves").mkdir(parents=True)
        (self.folder / "out").mkdir()
        for name, value in self.leaves.items():
            write_leaf(self.folder, name, value)
        self.tool.write(self.dag, self.folder)
        state = "ok"
        try:
            for phase in ["cold", *(phase for phase in PHASES if phase in phases and phase != "cold")]:
                cell = self._phase(phase) if state in ("ok", "wrong") else self._cell(phase, "skipped")
                state = cell.state
                yield cell
        finally:
            self.tool.stop(self.folder)

    def _phase(self, phase: str) -> Cell:
        before: list[object] = []

        def once() -> Cost:
            if phase == "back":
                self._edit("leaf")
                between = self._build()
                if not between.ok:
                    return between
            self._edit(phase)
            before[:] = [self.tool.stamps(self.folder, self.dag)]
            return self._build()

        times = 1 if phase == "cold" else self.limits.repeats
        cost = measure.best(once, times, self.limits.budget)
        if not cost.ok:
            return self._cell(phase, "slow" if cost.late else "failed", cost, why=cost.why)
        ran = self.tool.ran(self.folder, self.dag, before[0])
        why = self._wrong(phase, ran)
        return self._cell(phase, "wrong" if why else "ok", cost, ran, why)

    def _build(self) -> Cost:
        env = self.tool.environment(self.folder)
        return measure.cost(self.tool.command(self.folder), self.folder, self.limits.cell, env)

    def _edit(self, phase: str) -> None:
        time.sleep(self.tool.clock_s)
        if phase in ("leaf", "back", "comment"):
            self.comments += phase == "comment"
            self.leaves[LEAF] += {"leaf": 1, "back": -1, "comment": 0}[phase]
            write_leaf(self.folder, LEAF, self.leaves[LEAF], f"comment {self.comments}")
        elif phase == "touched":
            os.utime(self.folder / "leaves" / LEAF)
        elif phase == "deleted":
            self.tool.delete(self.folder, self.dag)

    def _wrong(self, phase: str, ran: int) -> str:
        """What is not as it must be, or ""."""
        values = evaluate(self.dag, self.leaves)
        for node in self.dag.sinks:
            path = self.tool.output(self.folder, node)
            found = path.read_text().strip() if path.exists() else "no file"
            if found != str(values[node]):
                return f"{node} is {found}, not {values[node]}"
        least, most = self._may_run(phase)
        return "" if least <= ran <= most else f"{ran} nodes ran, not {least} to {most}"

    def _may_run(self, phase: str) -> tuple[int, int]:
        everything, reached = len(self.dag.nodes), self.dag.reached_from(LEAF)
        readers = sum(LEAF in inputs for inputs in self.dag.nodes.values())
        return {
            "cold": (everything, everything),
            "no-op": (0, 0),
            "leaf": (reached, reached),
            "back": (0, reached),
            "comment": (0, readers if self.tool.cutoff else reached),
            "touched": (0, readers if self.tool.cutoff else reached),
            "deleted": (0, everything),
        }[phase]

    def _cell(self, phase: str, state: str, cost: Cost | None = None, ran: int | None = None, why: str = "") -> Cell:
        place = (self.tool.name, self.dag.shape, len(self.dag.nodes), phase, state)
        if cost is None or state in ("slow", "failed"):
            return Cell(*place, why=why)
        memory = max(cost.rss_mib, self.tool.memory_mib(self.folder))
        return Cell(*place, cost.seconds, cost.cpu, memory, ran, why)


def course(tool: Tool, dag: Dag, work: Path, limits: Limits, phases: list[str]) -> Iterator[Cell]:
    """Measure one tool on one graph in a new folder below `work`, and remove what it left."""
    folder = work / f"{tool.name}_{dag.shape}_{len(dag.nodes)}"
    try:
        yield from Course(tool, dag, folder, limits).run(phases)
    finally:
        for path in work.glob(f"{folder.name}*"):
            shutil.rmtree(path, onerror=_make_writable)


def _make_writable(remove: object, path: str, error: object) -> None:
    os.chmod(os.path.dirname(path), 0o755)
    if os.path.isdir(path) and not os.path.islink(path):
        os.chmod(path, 0o755)
        shutil.rmtree(path, ignore_errors=True)
    else:
        os.unlink(path)
