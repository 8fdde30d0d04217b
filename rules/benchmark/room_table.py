"""benchmark.room_table: the static scenes of many rooms, by method, as in the paper's Table III."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import metrics
from dextera_build.rule import Context, rule

from ..evaluate import fidelity
from .intervals import IntervalOptions


class RoomTableOptions(IntervalOptions):
    """Options of benchmark.room_table."""


@rule(version=1, packages=("numpy",))
def room_table(ctx: Context, tables: Collection[Table], *, options: RoomTableOptions | None = None) -> Table:
    """Return for each method and each kind of pixels the mean over rooms and its interval, then the paper's row.

    `tables` holds by method a table of `evaluate.views`, or of `benchmark.gather` over those of many rooms.
    """
    options = options or RoomTableOptions()
    rows: list[tuple[Cell, ...]] = []
    for method, table in tables.items.items():
        gathered = [column.name for column in table.columns][:1] == ["case"]
        scores = [row[1:] if gathered else row for row in table.rows]
        ctx.check(
            table.columns[gathered:] == fidelity.COLUMNS,
            f"the table of `{method}` does not hold the rows of `evaluate.views`",
            columns=", ".join(column.name for column in table.columns),
        )
        for area in dict.fromkeys(str(row[0]) for row in scores):
            rows += _rows(ctx, method, area, [row[1:] for row in scores if row[0] == area], options)
    paper = ("paper, HY-World", fidelity.PAPER[0], "mean", None, *fidelity.PAPER[1:])
    return Table(
        title="Rooms without their objects, from one photograph each",
        columns=(
            Column(name="Method"),
            fidelity.COLUMNS[0],
            Column(name="Statistic"),
            Column(name="Rooms"),
            *fidelity.COLUMNS[1:],
        ),
        rows=(*rows, paper),
        notes=(
            f"low, high: {options.confidence:.0%} percentile bootstrap interval of the mean, {options.draws} draws of "
            "rooms; a room counts with the mean of its views",
            "paper: DexTera, Table III: its own scenes from the camera that they were made from, another data set",
            *dict.fromkeys(note for table in tables.items.values() for note in table.notes if "means over" not in note),
        ),
    )


def _rows(
    ctx: Context, method: str, area: str, scores: list[tuple[Cell, ...]], options: RoomTableOptions
) -> list[tuple[Cell, ...]]:
    columns = [
        np.array([cell for cell in cells if isinstance(cell, int | float)], np.float64)
        for cells in zip(*scores, strict=True)
    ]
    means = [metrics.mean_std(values)[0] for values in columns]
    for column, mean in zip(fidelity.COLUMNS[1:], means, strict=True):
        if mean is not None:
            ctx.metric(f"{method}, {area}: {column.name}", mean, column.unit)
    rows: list[tuple[Cell, ...]] = [(method, area, "mean", len(scores), *means)]
    if len(scores) > 1:
        ends = [options.interval(values) for values in columns]
        rows.append((method, area, "low", None, *(low for low, _ in ends)))
        rows.append((method, area, "high", None, *(high for _, high in ends)))
    return rows
