"""benchmark.summary: merge the tables of many captures, with pooled means and their intervals."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import metrics
from dextera_build.rule import Context, rule

from .intervals import IntervalOptions


class SummaryOptions(IntervalOptions):
    """Options of benchmark.summary."""


@rule(version=1)
def summary(ctx: Context, tables: Collection[Table], *, options: SummaryOptions) -> Table:
    """Return a row per table and a row for all rows pooled: mean, standard deviation, count and interval.

    Numeric columns with a preferred direction are averaged; a column of results is counted.
    """
    if not tables.items:
        ctx.fail("no table was given", hint="check the pattern of the captures")
    labels = sorted(tables.items)
    first = tables.items[labels[0]]
    for label in labels:
        if tables.items[label].columns != first.columns:
            ctx.fail(f"the table of `{label}` has other columns than that of `{labels[0]}`")
    measures = [i for i, column in enumerate(first.columns) if column.better]
    kinds = _kinds([tables.items[label] for label in labels])
    rows = [_row(label, tables.items[label].rows, measures, kinds, options) for label in labels]
    pooled = tuple(row for label in labels for row in tables.items[label].rows)
    total = _row("all", pooled, measures, kinds, options)
    counted = ", ".join(f"{total[len(total) - len(kinds) + k]} {kind}" for k, kind in enumerate(kinds))
    if measures:
        name, mean = first.columns[measures[0]].name, total[2] if isinstance(total[2], float) else 0.0
        ctx.say(f"mean {name} {mean:.3f} over {total[1]} rows, {counted}".rstrip(", "))
        ctx.metric(f"mean {name}", mean)
    else:
        ctx.say(f"{len(pooled)} rows, {counted}")
    return Table(
        title=f"{first.title}, {len(labels)} captures",
        columns=_columns(first, measures, kinds),
        rows=(*rows, total),
        notes=(*_definitions(first), *_notes(options)),
    )


def _kinds(tables: list[Table]) -> list[str]:
    """Values of the column `result`, in alphabetical order."""
    found = set()
    for table in tables:
        names = [column.name for column in table.columns]
        if "result" in names:
            found |= {str(row[names.index("result")]) for row in table.rows}
    return sorted(found)


def _row(
    label: str, rows: tuple[tuple[Cell, ...], ...], measures: list[int], kinds: list[str], options: SummaryOptions
) -> tuple[Cell, ...]:
    cells: list[Cell] = [label]
    for i in measures:
        values = [float(cell) for cell in (row[i] for row in rows) if isinstance(cell, int | float)]
        mean, spread, count = metrics.mean_std(values)
        cells += [count, mean, spread, *options.interval(np.array(values))]
    cells += [sum(kind in row for row in rows) for kind in kinds]
    return tuple(cells)


def _columns(first: Table, measures: list[int], kinds: list[str]) -> tuple[Column, ...]:
    columns = [Column(name="capture")]
    for i in measures:
        column = first.columns[i]
        columns.append(Column(name="count" if len(measures) == 1 else f"{column.name} count"))
        for suffix in ("mean", "deviation", "low", "high"):
            better = column.better if suffix == "mean" else ""
            name = f"{column.name} {suffix}"
            columns.append(Column(name=name, unit=column.unit, digits=column.digits, better=better))
    return (*columns, *(Column(name=kind) for kind in kinds))


def _definitions(first: Table) -> tuple[str, ...]:
    """Notes that hold definitions; notes with counts apply to a single table."""
    return tuple(note for note in first.notes if ":" in note)


def _notes(options: SummaryOptions) -> tuple[str, ...]:
    return (
        "all: every row of every table, each with the same weight",
        "deviation: sample standard deviation (n - 1); no number for a single row",
        f"low, high: {options.confidence:.0%} percentile bootstrap interval of the mean, {options.draws} draws of rows",
    )
