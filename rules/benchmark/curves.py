"""benchmark.curves: success and accuracy as functions of one parameter at a time."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.draw import Draw
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.geometry import metrics
from dextera_build.geometry.plot import COLOURS, Line, plot
from dextera_build.rule import Context, rule
from dextera_build.statistics import wilson

from .intervals import IntervalOptions
from .pooled import Pool

COLUMNS = (
    Column(name="Quantity"),
    Column(name="Value"),
    Column(name="Photographs"),
    Column(name="Built", unit="%", digits=0, better="higher"),
    Column(name="True"),
    Column(name="Found", unit="%", digits=1, better="higher"),
    Column(name="Found low", unit="%", digits=1),
    Column(name="Found high", unit="%", digits=1),
    Column(name="Spurious", better="lower"),
    Column(name="Mask IoU", better="higher"),
    Column(name="IoU low"),
    Column(name="IoU high"),
    Column(name="F-score@1cm", better="higher"),
    Column(name="Chamfer-L1", unit="m", digits=4, better="lower"),
)


class CurvesOptions(IntervalOptions):
    """Options of benchmark.curves."""


@rule(version=1, packages=("numpy", "pillow"))
def curves(
    ctx: Context, drawn: Collection[Draw], scores: Table, expected: Table, *, options: CurvesOptions | None = None
) -> Table:
    """Return one row per value of each swept parameter: number of built photographs, objects found, mean IoU.

    `scores` are the gathered tables of `evaluate.objects` by draw, `expected` those of `evaluate.visible`. All objects
    of a photograph without a twin count as missed.
    """
    options = options or CurvesOptions()
    points: dict[tuple[str, str], list[str]] = {}
    for label, draw in drawn.items.items():
        points.setdefault((draw.axis, draw.value), []).append(label)
    built = {str(row[0]) for row in scores.rows}
    rows = []
    for (axis, value), labels in points.items():
        pool = Pool.of(scores, expected, frozenset(labels))
        rows.append((axis, value, len(labels), 100.0 * len(built & set(labels)) / len(labels), *_cells(pool, options)))
    for axis in dict.fromkeys(axis for axis, _ in points):
        own = [row for row in rows if row[0] == axis]
        picture = _picture(axis, own)
        if picture is not None:
            ctx.preview(picture, f"{axis}: photographs built (blue), objects found (red), mask IoU (green)")
    ctx.say(f"{len(rows)} points, {len(drawn.items)} photographs, {len(built)} built")
    return Table(
        title="Envelope",
        columns=COLUMNS,
        rows=tuple(rows),
        notes=(
            "built: photographs that became placed bodies; the objects of the others are missed",
            "found: of the true objects of which enough is visible (`evaluate.visible`); Wilson interval, "
            f"{options.confidence:.0%}",
            f"IoU low, high: {options.confidence:.0%} percentile bootstrap interval of the mean, {options.draws} draws "
            "of objects; a missed object counts with IoU 0, its other cells are empty",
        ),
    )


def _cells(pool: Pool, options: CurvesOptions) -> tuple[Cell, ...]:
    iou = pool.metrics["Mask IoU"]
    low, high = wilson(pool.found, pool.true, options.confidence)
    return (
        pool.true,
        100.0 * pool.found / pool.true if pool.true else None,
        100.0 * low if pool.true else None,
        100.0 * high if pool.true else None,
        pool.spurious,
        metrics.mean_std(iou)[0],
        *options.interval(iou),
        *(metrics.mean_std(pool.metrics[name])[0] for name in ("F-score@1cm", "Chamfer-L1")),
    )


def _picture(axis: str, rows: list[tuple[Cell, ...]]) -> np.ndarray | None:
    """Curves over the values, (H, W, 3) uint8; None if the values are no numbers."""
    try:
        places = np.array([float(str(row[1])) for row in rows])
    except ValueError:
        return None
    order = np.argsort(places)
    found = []
    for column, scale in (("Built", 1.0), ("Found", 1.0), ("Mask IoU", 100.0)):
        at = [known.name for known in COLUMNS].index(column)
        heights = [row[at] for row in rows]
        values = np.array([scale * h if isinstance(h, int | float) else np.nan for h in heights], np.float64)
        found.append(np.stack([places, values], axis=1)[order])
    return plot([Line(points, COLOURS[number]) for number, points in enumerate(found)], axis, "[%]")
