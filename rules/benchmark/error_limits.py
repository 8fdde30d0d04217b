"""benchmark.error_limits: errors of many scenes, by method, compared with limits."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.draw import Draw
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.rule import Context, rule
from dextera_build.statistics import bootstrap

from . import errors
from .intervals import IntervalOptions

COLUMNS = (
    Column(name="Quantity"),
    Column(name="Method"),
    Column(name="Unit"),
    Column(name="Expected"),
    Column(name="Count", better="higher"),
    Column(name="Median", better="lower"),
    Column(name="Low"),
    Column(name="High"),
    Column(name="90 % quantile", better="lower"),
    Column(name="Goal"),
    Column(name="Reached"),
    Column(name="In region"),
    Column(name="Region of"),
)


class ErrorLimitsOptions(IntervalOptions):
    """Options of benchmark.error_limits."""

    medians: dict[str, PositiveFloat] = Field(default_factory=dict)
    """Quantity -> limit of its median, in its unit."""


@rule(version=1, packages=("numpy",))
def error_limits(
    ctx: Context,
    tables: Collection[Table],
    drawn: Collection[Draw],
    objects: Table,
    *,
    options: ErrorLimitsOptions | None = None,
) -> Table:
    """Return for each quantity and method: count, median, its interval, the goal, and the coverage of stated regions.

    Args:
        ctx: Context.
        tables: Method -> errors, gathered over the scenes by `benchmark.gather`.
        drawn: The draws, which give the expected number of scenes; failed ones are missing in `Count`.
        objects: Gathered `evaluate.visible`, which give the expected number of objects.
        options: Options.
    """
    options = options or ErrorLimitsOptions()
    found: dict[tuple[str, str], list[tuple[Cell, ...]]] = {}
    for method, table in tables.items.items():
        names = [column.name for column in table.columns]
        wanted = ["case", *(column.name for column in errors.COLUMNS)]
        ctx.check(names == wanted, f"the rows of `{method}` are no errors", columns=", ".join(names))
        for row in table.rows:
            found.setdefault((str(row[2]), method), []).append(row)
    quantities = list(dict.fromkeys(quantity for quantity, _ in found))
    rows = [
        _row(quantity, method, own, len(objects.rows) if own[0][1] else len(drawn.items), options)
        for quantity in quantities
        for method in tables.items
        if (own := found.get((quantity, method)))
    ]
    for row in rows:
        if isinstance(row[5], float):
            ctx.metric(f"{row[0]}, {row[1]}", row[5], str(row[2]))
    missed = [f"{row[0]} ({row[1]})" for row in rows if row[10] == "no"]
    ctx.say(f"{len(drawn.items)} scenes; " + (f"goals missed: {', '.join(missed)}" if missed else "all goals reached"))
    notes = tuple(dict.fromkeys(note for table in tables.items.values() for note in table.notes))
    return Table(
        title="The second stage against the truth of simulated scenes",
        columns=COLUMNS,
        rows=tuple(rows),
        notes=(
            f"low, high: {options.confidence:.0%} percentile bootstrap interval of the median, {options.draws} draws",
            "expected: drawn scenes, or objects that count (`evaluate.visible`); failed or missed ones are not in "
            "`count`, and objects that do not count may be in it",
            "in region: truths inside the stated 95 % region, of the number of stated ones; reached: by the median",
            *notes,
        ),
    )


def _row(
    quantity: str, method: str, rows: list[tuple[Cell, ...]], expected: int, options: ErrorLimitsOptions
) -> tuple[Cell, ...]:
    values = np.array([row[4] for row in rows], np.float64)
    regions = [row[5] for row in rows if isinstance(row[5], bool)]
    middle = float(np.median(values))
    low, high = bootstrap(values, options.draws, options.confidence, options.seed, np.median)
    goal = options.medians.get(quantity)
    reached = None if goal is None else "yes" if middle <= goal else "no"
    return (
        quantity,
        method,
        rows[0][3],
        expected,
        len(values),
        middle,
        low,
        high,
        float(np.quantile(values, 0.9)),
        goal,
        reached,
        sum(regions) if regions else None,
        len(regions) if regions else None,
    )
