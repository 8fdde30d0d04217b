"""evaluate.transfer: correlation of success in the twin with success in other worlds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dextera_build.artifacts import table
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule
from dextera_build.statistics import mmrv, pearson, pearson_interval

from . import published
from .charts import Dot, scatter
from .series import Cell, Series, SeriesOptions

Point = tuple[float, float]
"""Success in the twin and in the other world, as fractions."""


class TransferOptions(SeriesOptions):
    """Options of evaluate.transfer."""

    paper: bool = True
    """Whether to append the paper's numbers."""


@dataclass(frozen=True)
class Match:
    """One policy in one task, in the twin and in another world."""

    twin: Cell
    """In the twin."""
    other: Cell
    """In the other world."""

    @property
    def point(self) -> Point:
        """Both rates."""
        return self.twin.rate.value, self.other.rate.value


@rule(version=2, packages=("numpy",))
def transfer(ctx: Context, trials: Collection[Trials], *, options: TransferOptions) -> table.Table:
    """Return Pearson's correlation and MMRV of success in the twin and in other worlds, over cells and over policies.

    A cell is one policy in one task of one world; replays are excluded: they are selected by success in the twin.
    """
    series = Series(ctx, trials, options.robots)
    matches = _matches(series)
    ctx.check(
        bool(matches),
        "no policy was tried both in a twin and in another world of the same task",
        hint="give the rollouts of both worlds",
        cells=", ".join(f"{cell.label} in {cell.pair} ({cell.world})" for cell in series.cells[:6]),
    )
    rows = _rows(matches)
    if options.paper:
        rows += _paper()
    r, violation = rows[0][2], rows[0][5]
    ctx.say(f"Pearson {_number(r)}, MMRV {_number(violation)} over {len(matches)} cells")
    for name, value in (("Pearson", r), ("MMRV", violation)):
        if isinstance(value, float):
            ctx.metric(name, value)
    worlds = sorted({match.other.trials.world for match in matches}, reverse=True)
    dots = [Dot(match.twin.label, _span(match.twin), _span(match.other)) for match in matches]
    ctx.preview(scatter(dots, f"success in the {' or '.join(worlds)} world [%]"), "each point is a policy in a task")
    return table.Table(
        title="How well the twin predicts the other world",
        columns=(
            table.Column(name="over"),
            table.Column(name="points"),
            table.Column(name="Pearson", better="higher"),
            table.Column(name="low"),
            table.Column(name="high"),
            table.Column(name="MMRV", better="lower"),
            table.Column(name="twin", unit="%", digits=1),
            table.Column(name="other world", unit="%", digits=1),
        ),
        rows=tuple(rows),
        notes=_notes(matches),
    )


def _matches(series: Series) -> list[Match]:
    found = []
    for cell in series.cells:
        twin = series.find(cell.pair, cell.label, "twin")
        if cell.world != "twin" and cell.trials.actor == "policy" and twin is not None:
            found.append(Match(twin, cell))
    return found


def _rows(matches: Sequence[Match]) -> list[tuple[table.Cell, ...]]:
    """All cells, the cells of each kind of world if there are several, and the policies' means over tasks."""
    rows = [_row("cells: policy in a task", [match.point for match in matches])]
    worlds = list(dict.fromkeys(match.other.world for match in matches))
    if len(worlds) > 1:
        rows += [
            _row(f"cells, {world} world", [match.point for match in matches if match.other.world == world])
            for world in worlds
        ]
    by_policy: dict[tuple[str, str], list[Point]] = {}
    for match in matches:
        by_policy.setdefault((match.twin.label, match.other.trials.poses), []).append(match.point)
    rows.append(_row("means of policies", [_middle(points) for points in by_policy.values()]))
    return rows


def _paper() -> list[tuple[table.Cell, ...]]:
    by_policy = {
        name: [(row[name][0].value, row[name][1].value) for row in published.POLICY.values()]
        for name in published.POLICIES
    }
    everything = [point for points in by_policy.values() for point in points]
    means = [_middle(points) for points in by_policy.values()]
    return [
        _row("paper, cells: simulation and hardware", everything),
        _row("paper, means of policies", means),
    ]


def _row(over: str, points: Sequence[Point]) -> tuple[table.Cell, ...]:
    here, there = [point[0] for point in points], [point[1] for point in points]
    r = pearson(here, there)
    low, high = (pearson_interval(r, len(points)) if r is not None else None) or (None, None)
    middle = _middle(points)
    return over, len(points), r, low, high, mmrv(here, there), 100 * middle[0], 100 * middle[1]


def _middle(points: Sequence[Point]) -> Point:
    return sum(point[0] for point in points) / len(points), sum(point[1] for point in points) / len(points)


def _span(cell: Cell) -> tuple[float, float, float]:
    return (cell.rate.value, *cell.rate.interval())


def _number(value: table.Cell) -> str:
    return f"{value:.2f}" if isinstance(value, float) else "-"


def _notes(matches: Sequence[Match]) -> tuple[str, ...]:
    same = sum(_seeds(match.twin) == _seeds(match.other) for match in matches)
    return (
        "Pearson: correlation of success rates; a dash below three points or where one side is all alike",
        "low, high: 95 % interval by Fisher's transformation, which takes the points for independent",
        "MMRV: mean over cells of the largest |R_i - R_j| among cells that the twin ranks otherwise (SIMPLER), 0 to 1;"
        " R in the other world",
        f"means: every task counts the same; {same} of {len(matches)} cells began at the same draws in both worlds",
        "the other world is simulated, too; only the paper's rows are about hardware",
    )


def _seeds(cell: Cell) -> set[int]:
    return {trial.seed for trial in cell.trials.items}
