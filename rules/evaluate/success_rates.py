"""evaluate.success_rates: success rate, progress, intervals, time and failure reasons of every set of trials."""

from __future__ import annotations

from pydantic import PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.artifacts.tasks.reasons import spelled
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule

from .series import Series, SeriesOptions


class SuccessRatesOptions(SeriesOptions):
    """Options of evaluate.success_rates."""

    reasons: PositiveInt = 4
    """Maximum number of reasons listed, most frequent first."""


@rule(version=2, packages=("numpy",))
def success_rates(ctx: Context, trials: Collection[Trials], *, options: SuccessRatesOptions) -> Table:
    """Return one row per set of trials: successes and progress [%] with 95 % intervals, mean time [s], reasons."""
    series = Series(ctx, trials, options.robots)
    rows: list[tuple[Cell, ...]] = []
    for cell in series.cells:
        ends = [100 * end for rate in (cell.rate, cell.progress) for end in (rate.value, *rate.interval())]
        rows.append(
            (
                str(cell.pair),
                cell.label,
                cell.world,
                cell.rate.trials,
                cell.rate.successes,
                *ends,
                cell.trials.mean_time_s,
                _judged(cell.trials),
                spelled(cell.trials.reasons, options.reasons) or None,
                spelled(cell.trials.excluded, options.reasons) or None,
            )
        )
    tried = sum(cell.rate.trials for cell in series.cells)
    done = sum(cell.rate.successes for cell in series.cells)
    ctx.say(f"{len(rows)} sets of trials, {tried:,} tries, {done:,} succeeded")
    return Table(
        title="Outcomes of all trials",
        columns=(
            *(Column(name=name) for name in ("task", "actor", "world", "trials", "successes")),
            Column(name="success", unit="%", digits=1, better="higher"),
            Column(name="low", unit="%", digits=1),
            Column(name="high", unit="%", digits=1),
            Column(name="progress", unit="%", digits=1, better="higher"),
            Column(name="progress, low", unit="%", digits=1),
            Column(name="progress, high", unit="%", digits=1),
            Column(name="mean time", unit="s", digits=2, better="lower"),
            Column(name="judged alike"),
            Column(name="failures"),
            Column(name="left out"),
        ),
        rows=tuple(rows),
        notes=(
            "low, high: 95 % Wilson interval, or a confidence sequence if the results decided when the trials ended",
            "progress: the last stage of its task that a trial reached, as a fraction of all stages, success being the"
            " last; mean over trials, with an interval that is rather too wide",
            "mean time: of the successes, from the start to the verdict, the time that success must hold included",
            "judged alike: trials with a tracker in which the predicate gives the same verdict on the measurements as"
            " on the truth, or on a robot as the operator, whose verdict counts",
            "left out: starts that brought no trial, because no start without collisions was found, or because nothing"
            " succeeded in the twin that could be replayed; they are no failures and do not enter the rate",
        ),
    )


def _judged(trials: Trials) -> str | None:
    """`19 of 20`, or None if no trial was judged twice."""
    seen = [
        trial.sighting.success == trial.success
        for trial in trials.items
        if trial.sighting is not None and trial.sighting.success is not None
    ]
    seen += [
        trial.verdicts.measured == trial.verdicts.operator
        for trial in trials.items
        if trial.verdicts is not None and trial.verdicts.operator is not None
    ]
    return f"{sum(seen)} of {len(seen)}" if seen else None
