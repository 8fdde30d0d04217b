"""evaluate.transfer: correlation of success in the twin with success in other worlds, and what the twin adds there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dextera_build.artifacts import table
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule
from dextera_build.statistics import Rate, joined, mean, mmrv, pearson, pearson_interval
from dextera_build.statistics import paired as counts_of

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

    def __str__(self) -> str:
        return f"{self.twin.label} in {self.twin.pair}, {self.other.world} world"

    @property
    def joined(self) -> Rate | None:
        """Success in the other world, estimated with the twin's trials from other starts.

        None if there are none, if a start was tried in the other world alone, or if the results decided when the
        trials ended.
        """
        shared = self.twin.shared(self.other)
        known = {here for here, _ in shared}
        rest = [trial.success for number, trial in enumerate(self.twin.trials.items) if number not in known]
        fixed = not (self.twin.trials.stopped or self.other.trials.stopped)
        if not fixed or not rest or len(shared) < len(self.other.trials.items):
            return None
        return joined(counts_of(*self.twin.against(self.other)), Rate(sum(rest), len(rest)))


@rule(version=3, packages=("numpy",))
def transfer(ctx: Context, trials: Collection[Trials], *, options: TransferOptions) -> table.Table:
    """Return Pearson's correlation and MMRV of success in the twin and in other worlds, over cells and over policies.

    A cell is one policy in one task of one world; replays are excluded: they are selected by success in the twin.
    Success in the other world [%] is also estimated jointly from the trials of both worlds (prediction-powered).
    """
    series = Series(ctx, trials, options.robots)
    matches = _matches(series)
    ctx.check(
        bool(matches),
        "no policy was tried both in a twin and in another world of the same task",
        hint="give the rollouts of both worlds",
        cells=", ".join(f"{cell.label} in {cell.pair} ({cell.world})" for cell in series.cells[:6]),
    )
    rows = [*_rows(matches), *(_cells(str(match), [match]) for match in matches)]
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
            *(table.Column(name=name, unit="%", digits=1) for name in _ends("other world")),
            *(table.Column(name=name, unit="%", digits=1) for name in _ends("joined")),
            table.Column(name="trials"),
            table.Column(name="saved", digits=1, better="higher"),
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
    rows = [_cells("cells: policy in a task", matches)]
    worlds = list(dict.fromkeys(match.other.world for match in matches))
    if len(worlds) > 1:
        rows += [
            _cells(f"cells, {world} world", [match for match in matches if match.other.world == world])
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


def _cells(over: str, matches: Sequence[Match]) -> tuple[table.Cell, ...]:
    """The row of some cells, with the interval of the other world alone and joined with the twin."""
    rates, estimates = [match.other.rate for match in matches], [match.joined for match in matches]
    trials = int(sum(rate.trials for rate in rates))
    ends: list[table.Cell] = [*_percent(rates)[1:], *_NOTHING[2:5], trials, None]
    if any(estimates):
        best = [estimate or rate for estimate, rate in zip(estimates, rates, strict=True)]
        ends[2:5], ends[6] = _percent(best), sum(rate.trials for rate in best) - trials
    return _row(over, [match.point for match in matches], ends)


_NOTHING: tuple[table.Cell, ...] = (None,) * 7
"""Intervals and counts of a row without trials of its own."""


def _row(over: str, points: Sequence[Point], ends: Sequence[table.Cell] = _NOTHING) -> tuple[table.Cell, ...]:
    here, there = [point[0] for point in points], [point[1] for point in points]
    r = pearson(here, there)
    low, high = (pearson_interval(r, len(points)) if r is not None else None) or (None, None)
    middle = _middle(points)
    return over, len(points), r, low, high, mmrv(here, there), 100 * middle[0], 100 * middle[1], *ends


def _percent(rates: Sequence[Rate]) -> list[float]:
    """Mean and interval of rates, at least one [%]."""
    return [100 * end for end in mean(rates) or ()]


def _middle(points: Sequence[Point]) -> Point:
    return sum(point[0] for point in points) / len(points), sum(point[1] for point in points) / len(points)


def _span(cell: Cell) -> tuple[float, float, float]:
    return (cell.rate.value, *cell.rate.interval())


def _ends(what: str) -> tuple[str, str, str]:
    """Names of the columns of an estimate and its interval."""
    return what, f"{what}, low", f"{what}, high"


def _number(value: table.Cell) -> str:
    return f"{value:.2f}" if isinstance(value, float) else "-"


def _notes(matches: Sequence[Match]) -> tuple[str, ...]:
    same = sum(_seeds(match.twin) == _seeds(match.other) for match in matches)
    return (
        "Pearson: correlation of success rates; a dash below three points or where one side is all alike",
        "low, high: 95 % interval by Fisher's transformation, which takes the points for independent",
        "MMRV: mean over cells of the largest |R_i - R_j| among cells that the twin ranks otherwise (SIMPLER), 0 to 1;"
        " R in the other world; of cells that tie in the twin alone, the better one counts as ranked otherwise",
        "other world, low, high: 95 % Wilson interval, of several cells by MOVER",
        "joined: success in the other world, estimated from its trials, the twin's from the same starts, and the twin's"
        " from other starts (prediction-powered, weight of least variance)",
        "saved: trials in the other world that an interval as narrow would take in addition without the twin",
        f"means: every task counts the same; {same} of {len(matches)} cells began at the same draws in both worlds",
        "the other world is simulated, too; only the paper's rows are about hardware",
    )


def _seeds(cell: Cell) -> set[int]:
    return {trial.seed for trial in cell.trials.items}
