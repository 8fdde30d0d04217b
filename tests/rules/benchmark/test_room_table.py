"""benchmark.room_table: means over rooms with their intervals, the paper's row last."""

from __future__ import annotations

from pathlib import Path

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.table import Column, Table
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from rules.evaluate import fidelity


def scores(psnr: float) -> Table:
    numbers = [psnr if column.name == "PSNR" else 0.5 for column in fidelity.COLUMNS[1:]]
    return Table(title="room", columns=fidelity.COLUMNS, rows=(("all", *numbers), ("seen by the capture", *numbers)))


def compared(tmp_path: Path, **tables: Table) -> tuple[dict[tuple[str, ...], dict[str, object]], RuleRunner]:
    runner = RuleRunner(tmp_path)
    made: Table = runner.run("benchmark.room_table", tables=Collection[Table](items=tables))
    names = [column.name for column in made.columns]
    rows = [dict(zip(names, row, strict=True)) for row in made.rows]
    return {(str(r["Method"]), str(r["Pixels"]), str(r["Statistic"])): r for r in rows}, runner


def test_rooms_are_pooled_by_method_and_pixels(tmp_path: Path) -> None:
    many = Collection[Table](items={"0": scores(20.0), "1": scores(24.0), "2": scores(25.0)})
    gathered = RuleRunner(tmp_path).run("benchmark.gather", tables=many)
    found, runner = compared(tmp_path, ours=gathered, sheet=scores(15.0))
    mean = found["ours", "all", "mean"]
    assert mean["PSNR"] == pytest.approx(23.0)
    assert mean["Rooms"] == 3
    low, high = (found["ours", "all", end]["PSNR"] for end in ("low", "high"))
    assert 20.0 <= low < 23.0 < high <= 25.0  # type: ignore[operator]
    assert found["sheet", "all", "mean"]["PSNR"] == 15.0
    assert ("sheet", "all", "low") not in found, "one room has no interval"
    assert list(found)[-1][0] == "paper, HY-World"
    assert found[list(found)[-1]]["PSNR"] == 20.74
    assert runner.outcome.metrics["ours, all: PSNR"][0] == pytest.approx(23.0)


def test_another_table_is_refused(tmp_path: Path) -> None:
    other = Table(title="other", columns=(Column(name="Pixels"),), rows=(("all",),))
    with pytest.raises(RuleError, match="does not hold the rows"):
        compared(tmp_path, ours=other)
