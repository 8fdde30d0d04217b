"""Methods beside one another, and curves: what was missed counts, also in photographs that became no twin."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.scenes.draw import Arrangement, Draw, Sensor, Viewpoint
from dextera_build.artifacts.table import Cell, Column, Table
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.evaluate import objects, visible


def row(case: str, name: str, iou: float | None, f_score: float | None = 0.9) -> tuple[Cell, ...]:
    """A row of a gathered table of `evaluate.objects`; without an IoU, of a spurious asset."""
    if iou is None:
        return (case, objects.SPURIOUS, "ghost", *[None] * (len(objects.COLUMNS) - 2))
    if iou == 0.0:
        return (case, name, "missed", 0.8, *objects.MISSED)
    return (case, name, "asset", 0.8, iou, 0.9, 0.8, 0.05, 8.0, 0.003, 0.004, 0.003, f_score)


def scores(*rows: tuple[Cell, ...]) -> Table:
    return Table(title="Objects", columns=(Column(name="case"), *objects.COLUMNS), rows=rows)


def expected(**counts: int) -> Table:
    rows = tuple((case, f"thing_{n}", 0.8) for case, count in counts.items() for n in range(count))
    return Table(title="True", columns=(Column(name="case"), *visible.COLUMNS), rows=rows)


def cell(table: Table, first: tuple[str, str], column: str) -> Cell:
    names = [known.name for known in table.columns]
    return next(cells for cells in table.rows if cells[:2] == first)[names.index(column)]


def test_objects_of_a_lost_photograph_are_missed(tmp_path: Path) -> None:
    ours = scores(row("a", "cup", 0.9), row("a", "box", 0.0), row("a", "", None))
    better = scores(row("a", "cup", 0.8), row("a", "box", 0.8), row("b", "cup", 0.8))
    table = RuleRunner(tmp_path).run(
        "benchmark.method_table",
        tables=Collection[Table](items={"Ours": ours, "Other": better}),
        expected=expected(a=2, b=1),
    )
    assert cell(table, ("Ours", "mean"), "True") == 3
    assert cell(table, ("Ours", "mean"), "Photographs") == 1
    assert cell(table, ("Ours", "mean"), "Found") == pytest.approx(100 / 3)
    assert cell(table, ("Ours", "mean"), "Spurious") == 1
    assert cell(table, ("Ours", "mean"), "Mask IoU") == pytest.approx(0.3)
    assert cell(table, ("Ours", "count"), "Mask IoU") == 3
    # What was missed enters no other column.
    assert cell(table, ("Ours", "mean"), "F-score@1cm") == pytest.approx(0.9)
    assert cell(table, ("Ours", "count"), "F-score@1cm") == 1
    assert cell(table, ("Other", "mean"), "Mask IoU") == pytest.approx(0.8)
    low, high = (cell(table, ("Ours", end), "Mask IoU") for end in ("low", "high"))
    assert isinstance(low, float)
    assert isinstance(high, float)
    assert 0.0 <= low < 0.3 < high <= 0.9
    assert cell(table, ("paper, Ours", "mean"), "Mask IoU") == 0.731
    assert cell(table, ("paper, Ours", "deviation"), "Chamfer-L1") == 0.0076


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=r"does not hold the rows of `evaluate\.objects`"):
        RuleRunner(tmp_path).run(
            "benchmark.method_table", tables=Collection[Table](items={"Ours": expected(a=1)}), expected=expected(a=1)
        )


def draw(axis: str, value: str) -> Draw:
    return Draw(
        arrangement=Arrangement(seed=1, count=2, contact="apart"),
        viewpoint=Viewpoint(seed=1, distance_m=0.8, pitch_deg=40.0, roll_deg=0.0, width_px=640),
        sensor=Sensor(seed=1, noise=1.0, dropout=0.0),
        axis=axis,
        value=value,
    )


def test_a_curve_has_a_point_per_value_with_what_was_not_built(tmp_path: Path) -> None:
    draws = {
        "near 0": draw("distance_m", "0.5"),
        "far 0": draw("distance_m", "2.0"),
        "far 1": draw("distance_m", "2.0"),
        "piled 0": draw("contact", "piled"),
    }
    runner = RuleRunner(tmp_path)
    table = runner.run(
        "benchmark.curves",
        drawn=Collection[Draw](items=draws),
        scores=scores(row("near 0", "cup", 0.9), row("near 0", "box", 0.8), row("far 0", "cup", 0.5)),
        expected=expected(**{"near 0": 2, "far 0": 1, "far 1": 2, "piled 0": 3}),
    )
    assert [cells[:3] for cells in table.rows] == [
        ("distance_m", "0.5", 1),
        ("distance_m", "2.0", 2),
        ("contact", "piled", 1),
    ]
    assert cell(table, ("distance_m", "0.5"), "Found") == 100.0
    assert cell(table, ("distance_m", "2.0"), "Built") == 50.0
    assert cell(table, ("distance_m", "2.0"), "True") == 3
    assert cell(table, ("distance_m", "2.0"), "Mask IoU") == pytest.approx(0.5 / 3)
    assert cell(table, ("contact", "piled"), "Built") == 0.0
    assert cell(table, ("contact", "piled"), "Mask IoU") == 0.0
    # Words are no axis; numbers are drawn.
    assert len(runner.outcome.previews) == 1
