"""A row beside the graphs, and what a measurement of such rows is given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeAlias

from tests.benchmarks.engine import measure
from tests.benchmarks.engine.dags import SHAPES
from tests.benchmarks.engine.measure import Cost
from tests.benchmarks.engine.phases import Cell, Limits, course
from tests.benchmarks.engine.tools.tool import Tool


@dataclass(frozen=True)
class Row:
    """One figure."""

    what: str
    tool: str
    value: float | None
    """None: it failed or took too long, and `note` says which."""
    unit: str
    note: str = ""

    def to_json(self) -> dict[str, object]:
        """Plain data."""
        return asdict(self)


@dataclass
class Bench:
    """What a run of the program has: the tools that are present, a folder, limits, and what it has measured so far."""

    tools: Mapping[str, Tool]
    work: Path
    limits: Limits
    cells: list[Cell] = field(default_factory=list)
    _made: list[Cell] = field(default_factory=list)

    def present(self, *names: str) -> Iterator[Tool]:
        """Those of the tools that are here."""
        return (self.tools[name] for name in names if name in self.tools)

    def cell(self, tool: Tool, shape: str, size: int, phase: str, *also: str) -> Cell:
        """A phase of a graph; what was not measured before is measured now, `also` with it.

        Where the phase was not reached, this is the cell that says why.
        """
        found = self._find(tool, shape, size, phase)
        if found is None:
            self._made += course(tool, SHAPES[shape](size), self.work, self.limits, [phase, *also])
            found = self._find(tool, shape, size, phase)
        assert found is not None
        return found

    def _find(self, tool: Tool, shape: str, size: int, phase: str) -> Cell | None:
        cells = [*self.cells, *self._made]
        here = [cell for cell in cells if (cell.tool, cell.shape, cell.size) == (tool.name, shape, size)]
        ended = [cell for cell in here if cell.state in ("slow", "failed")]
        asked = [cell for cell in here if cell.phase == phase]
        return next((cell for cell in asked if cell.state != "skipped"), next(iter([*ended, *asked]), None))

    def quickest(self, command: Sequence[str], folder: Path, times: int | None = None, **env: str) -> Cost:
        """The cheapest of several runs of a command."""

        def once() -> Cost:
            return measure.cost(command, folder, self.limits.cell, env)

        return measure.best(once, times or self.limits.repeats, self.limits.budget)


Extra: TypeAlias = Callable[[Bench], Iterator[Row]]


def of_cost(what: str, tool: str, cost: Cost, value: float | None = None, unit: str = "s", note: str = "") -> Row:
    """A row with the wall time of a command, or with `value`, which was made of it."""
    if not cost.ok:
        return Row(what, tool, None, unit, cost.why)
    return Row(what, tool, cost.seconds if value is None else value, unit, note)
