"""evaluate.each_trial: success, progress, time and reason of every single trial."""

from __future__ import annotations

from collections.abc import Iterator

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell as Entry
from dextera_build.artifacts.table import Column, Table
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule

from .series import Cell, Series, SeriesOptions


class EachTrialOptions(SeriesOptions):
    """Options of evaluate.each_trial."""


@rule(version=1, packages=("numpy",))
def each_trial(ctx: Context, trials: Collection[Trials], *, options: EachTrialOptions) -> Table:
    """Return one row per trial: the last stage reached, progress [%], success, time [s] and the reason of a failure."""
    series = Series(ctx, trials, options.robots)
    rows = tuple(row for cell in series.cells for row in _rows(cell))
    ctx.say(f"{len(rows):,} trials of {len(series.cells)} sets")
    return Table(
        title="Every trial",
        columns=(
            *(Column(name=name) for name in ("task", "actor", "world", "seed", "success", "stage")),
            Column(name="progress", unit="%", digits=0, better="higher"),
            Column(name="time", unit="s", digits=2),
            Column(name="reason"),
        ),
        rows=rows,
        notes=(
            "seed: the same seed is the same start for every actor in a world",
            "stage: the last stage of the task that was reached at any time, by the true state; the fraction of all"
            " stages, success being the last, is the progress",
        ),
    )


def _rows(cell: Cell) -> Iterator[tuple[Entry, ...]]:
    stages = ("none", *cell.trials.stages)
    about = (str(cell.pair), cell.label, cell.world)
    for trial, progress in zip(cell.trials.items, cell.trials.progress, strict=True):
        time_s = trial.steps / cell.trials.task.control_hz
        yield (
            *about,
            trial.seed,
            trial.success,
            stages[trial.stage],
            100 * float(progress),
            time_s,
            trial.reason or None,
        )
