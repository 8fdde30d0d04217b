"""benchmark.method_table: comparison of methods over many scenes, as in the paper's Table II."""

from __future__ import annotations

from collections.abc import Sequence

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import metrics
from dextera_build.rule import Context, rule

from ..evaluate import objects
from .intervals import IntervalOptions
from .pooled import Pool


class MethodTableOptions(IntervalOptions):
    """Options of benchmark.method_table."""


@rule(version=1, packages=("numpy",))
def method_table(
    ctx: Context, tables: Collection[Table], expected: Table, *, options: MethodTableOptions | None = None
) -> Table:
    """Return five rows per method: mean, deviation, both ends of the interval, and count, then the paper's rows.

    `tables` holds the gathered tables of `evaluate.objects` (without a summary) of each method, by its name, and
    `expected` those of `evaluate.visible`: all objects of a photograph without a twin count as missed.
    """
    options = options or MethodTableOptions()
    rows: list[tuple[Cell, ...]] = []
    for name, table in tables.items.items():
        pool = Pool.of(table, expected)
        sums = {key: metrics.mean_std(values) for key, values in pool.metrics.items()}
        rows += _rows(name, pool, list(sums.values()), options)
        means = {key: mean for key, (mean, _, _) in sums.items() if mean is not None}
        ctx.say(f"{name}: {pool.found} of {pool.true} found, mean IoU {means.get('Mask IoU', 0.0):.3f}")
        for key, mean in means.items():
            ctx.metric(f"{name}: {key}", mean, next(column.unit for column in objects.COLUMNS if column.name == key))
        ctx.metric(f"{name}: found", 100.0 * pool.found / max(pool.true, 1), "%")
    return Table(
        title="Objects of many scenes against the truth",
        columns=(
            Column(name="Method"),
            Column(name="Statistic"),
            Column(name="Photographs"),
            Column(name="True"),
            Column(name="Found", unit="%", digits=1, better="higher"),
            Column(name="Spurious", better="lower"),
            *objects.COLUMNS[3:],
        ),
        rows=(*rows, *_paper()),
        notes=(
            f"low, high: {options.confidence:.0%} percentile bootstrap interval of the mean, {options.draws} draws of "
            "instances",
            "a missed object counts with IoU 0 and enters no other column; `count` says how many do",
            "photographs: those that became a twin; the objects of the others are missed",
            "spurious: assets that match no true object",
            "true: objects of which at least the share that `evaluate.objects` states is visible, and which the border "
            "of the picture does not cut",
            *objects.DEFINITIONS,
        ),
    )


def _rows(
    name: str, pool: Pool, sums: Sequence[tuple[float | None, float | None, int]], options: MethodTableOptions
) -> list[tuple[Cell, ...]]:
    ends = [options.interval(values) for values in pool.metrics.values()]
    facts = (pool.scenes, pool.true, 100.0 * pool.found / max(pool.true, 1), pool.spurious)
    none: tuple[Cell, ...] = (None,) * len(facts)
    return [
        (name, "mean", *facts, *(mean for mean, _, _ in sums)),
        (name, "deviation", *none, *(deviation for _, deviation, _ in sums)),
        (name, "low", *none, *(low for low, _ in ends)),
        (name, "high", *none, *(high for _, high in ends)),
        (name, "count", *none, *(count for _, _, count in sums)),
    ]


def _paper() -> list[tuple[Cell, ...]]:
    return [
        ("paper, Ours", label.rsplit(" ", 1)[-1], None, 86 if number == 0 else None, None, None, *cells)
        for number, (label, _, _, *cells) in enumerate(objects.PAPER)
        if isinstance(label, str)
    ]
