"""evaluate.success: success of policies and replays in the layout of the paper's Tables IV and V."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.artifacts import table
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.rule import Context, rule
from dextera_build.statistics import Rate, mean

from . import published
from .charts import Bar, bars
from .series import TRACKED, Pair, Series, SeriesOptions

Row = tuple[table.Cell, ...]


class SuccessOptions(SeriesOptions):
    """Options of evaluate.success."""

    policies: tuple[str, ...] = ()
    """Columns; empty: the policies with trials. Name `T-S` or other policies of the paper to show their numbers."""
    paper: bool = True
    """Whether to append the paper's rows for the same tasks."""


@rule(version=2, packages=("numpy",))
def success(ctx: Context, trials: Collection[Trials], *, options: SuccessOptions) -> table.Table:
    """Return success rates [%] with 95 % Wilson intervals, one row per task, robot and pair of worlds.

    Means with equal weight per task and the paper's hardware numbers follow.
    """
    series = Series(ctx, trials, options.robots)
    columns = list(options.policies or series.policies)
    rows = [_row(series, pair, world, columns) for pair in series.pairs for world in series.worlds(pair) or [""]]
    ways = [TRACKED] if any(cell.world.endswith(TRACKED) for cell in series.cells) else []
    rows += [_mean(series, columns, way) for way in ["", *ways]]
    if options.paper:
        rows += _paper(series.pairs, columns)
    best = [f"{label} {_both(_means(series, label), short=True)}" for label in columns if any(_means(series, label))]
    replays = [cell.rate for cell in series.cells if cell.trials.actor == "replay"]
    told = f"replay {sum(rate.successes for rate in replays)}/{sum(rate.trials for rate in replays)}"
    ctx.say(", ".join([*best, *([told] if replays else [])]) + f", {len(series.pairs)} tasks")
    ctx.preview(bars(_bars(series)), "success [%] with 95 % Wilson intervals")
    return table.Table(
        title="Success of policies and replays",
        columns=(
            *(table.Column(name=name) for name in ("task", "worlds", "trials")),
            *(table.Column(name=name, unit="%") for name in (*columns, "replay")),
        ),
        rows=tuple(rows),
        notes=_notes(series, columns, options.paper),
    )


def _row(series: Series, pair: Pair, world: str, columns: Sequence[str]) -> Row:
    rates = [(series.rate(pair, label, "twin"), series.rate(pair, label, world)) for label in columns]
    replayed = series.rate(pair, "replay", world)
    counts = list(dict.fromkeys(_counts(both) for both in rates if any(both)))
    counts += [f"replay {replayed.trials}"] if replayed else []
    texts = [_both([_limits(rate) for rate in both]) for both in rates]
    last = _both([_limits(replayed)]) if replayed else None
    return (str(pair), f"twin / {world or '-'}", ", ".join(counts), *texts, last)


def _mean(series: Series, columns: Sequence[str], way: str) -> Row:
    texts = [_both(_means(series, label, way)) for label in columns]
    _, replayed = _means(series, "replay", way)
    last = _both([replayed]) if replayed else None
    return (f"mean of {len(series.pairs)} tasks", f"twin / other{way}", "", *texts, last)


Limits = tuple[float, float, float]
"""A rate and its interval, as fractions."""


def _means(series: Series, label: str, way: str = "") -> list[Limits | None]:
    """Mean over tasks in the twin and in the other world, preferring the reference world over a perturbed one.

    `way` is `TRACKED` for the trials with a tracker in the other world, empty for those with exact poses.
    """
    here = [series.rate(pair, label, "twin") for pair in series.pairs]
    there = [
        next(
            (
                rate
                for world in series.worlds(pair)
                if world.endswith(TRACKED) == bool(way) and (rate := series.rate(pair, label, world))
            ),
            None,
        )
        for pair in series.pairs
    ]
    return [mean([rate for rate in rates if rate]) for rates in (here, there)]


def _paper(pairs: Sequence[Pair], columns: Sequence[str]) -> list[Row]:
    """The paper's rows of the same task and robot, or marked rows with another robot; and its means."""
    rows: list[Row] = []
    for pair in pairs:
        same = [known for known in published.POLICY if known == (pair.robot, pair.task)]
        other = [known for known in published.POLICY if known[1] == pair.task]
        for known in same or other:
            mark = "paper" if same else "paper, another robot"
            cells = [published.POLICY[known].get(label) for label in columns]
            texts = [_both([_limits(rate) for rate in both]) if both else None for both in cells]
            replayed = _both([_limits(published.REPLAY[known])])
            source = f"{mark}: simulation / hardware"
            rows.append((f"{known[0]}: {known[1]}", source, _published_counts(), *texts, replayed))
    if rows:
        means = [_published_mean(label) for label in columns]
        last = _both([mean(list(published.REPLAY.values()))])
        name = f"mean of {len(published.POLICY)} tasks"
        rows.append((name, "paper: simulation / hardware", _published_counts(), *means, last))
    return rows


def _published_counts() -> str:
    return f"{published.TRIALS[0]} / {published.TRIALS[1]}, replay {published.REPLAYS}"


def _published_mean(label: str) -> str | None:
    if label not in published.POLICIES:
        return None
    cells = [row[label] for row in published.POLICY.values()]
    return _both([mean([both[side] for both in cells]) for side in (0, 1)])


def _limits(rate: Rate | None) -> Limits | None:
    return (rate.value, *rate.interval()) if rate else None


def _both(parts: Sequence[Limits | None], *, short: bool = False) -> str | None:
    """`93 (86-97) / 88 (80-93)`, a dash for cells without trials; None if no cell has trials."""
    if not any(parts):
        return None
    return " / ".join(_percent(part, short) if part else "-" for part in parts)


def _percent(part: Limits, short: bool) -> str:
    value, low, high = (100 * number for number in part)
    return f"{value:.0f}" if short else f"{value:.0f} ({low:.0f}-{high:.0f})"


def _counts(both: Sequence[Rate | None]) -> str:
    return " / ".join(str(rate.trials) if rate else "-" for rate in both)


def _bars(series: Series) -> dict[str, list[Bar]]:
    """One bar per world for each task and actor."""
    groups: dict[str, list[Bar]] = {}
    for cell in series.cells:
        low, high = cell.rate.interval()
        groups.setdefault(f"{cell.pair}\n{cell.label}", []).append(Bar(cell.world, cell.rate.value, low, high))
    return groups


def _notes(series: Series, columns: Sequence[str], paper: bool) -> tuple[str, ...]:
    over = [
        f"{label} over {len({cell.pair for cell in series.cells if cell.label == label})}"
        for label in [*columns, "replay"]
        if any(cell.label == label for cell in series.cells)
    ]
    excluded = sum(sum(cell.trials.excluded.values()) for cell in series.cells)
    notes = [
        "a / b: success in the twin / in the other world [%], in brackets the 95 % Wilson interval",
        "reference: a simulated world with its own shapes and physics, a stand-in for hardware; perturbed: the twin"
        " with disturbed geometry and physics; neither is real",
        "tracked: poses of objects are those of a tracker on noisy frames of one camera, placed by a calibration; an"
        " object that it does not find before the trial is a failure; elsewhere poses are exact",
        "replay: joint targets that succeeded in the twin, sent open loop to the other world",
        f"mean: every task counts the same; {', '.join(over)}; the interval adds those of the tasks (MOVER)",
        f"starts left out because no trial came about: {excluded}",
    ]
    if paper:
        notes.append(
            "paper: Tables IV and V, on hardware; 100 trials in simulation and 20 on hardware per cell, 30 replays per"
            " task; the intervals are computed here"
        )
    return tuple(notes)
