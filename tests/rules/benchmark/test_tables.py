"""benchmark.dimensions, benchmark.gather and benchmark.settle_table: tables from known bodies."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.scene import Settled, SettleReport
from dextera_build.artifacts.table import Column, Table
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def test_dimensions_are_those_of_the_nearest_body(runner):
    near = factories.box_asset(size=(0.06, 0.158, 0.21))
    away = near.pose.matrix.copy()
    away[:3, 3] += [0.0, 5.0, 0.0]
    far = near.model_copy(update={"pose": factories.placed(away)})
    table = runner.run(
        "benchmark.dimensions",
        assets=Collection[Asset](items={"far": far, "near": near}),
        support=factories.support(),
        options={"size_m": (0.21, 0.06, 0.158), "height_m": 0.2, "hollow": True},
    )
    rows = {row[1]: row for row in table.rows}
    assert {row[0] for row in table.rows} == {"near"}
    for number in (1, 2, 3):
        assert rows[f"edge {number}"][4] == pytest.approx(0.0, abs=0.01)
    assert rows["height"][4] == pytest.approx(10.0, abs=0.01)
    assert rows["closed"][3] == 1.0
    assert rows["hollow"][2:4] == (1.0, 0.0)


def test_dimensions_of_nothing_are_refused(runner):
    with pytest.raises(RuleError, match="no object was found"):
        runner.run("benchmark.dimensions", assets=Collection[Asset](items={}), support=factories.support())
    unknown = factories.support().model_copy(update={"scale": "unknown"})
    with pytest.raises(RuleError, match="cannot be compared with a ruler"):
        runner.run("benchmark.dimensions", assets=Collection[Asset](items={}), support=unknown)


def table(*rows: tuple[float, ...], column: str = "a") -> Table:
    return Table(title="t", columns=(Column(name=column),), rows=rows, notes=("n",))


def test_gathered_rows_carry_the_label_of_their_table(runner):
    parts = Collection[Table](items={"x": table((1.0,)), "y": table((2.0,), (3.0,))})
    whole = runner.run("benchmark.gather", tables=parts)
    assert whole.rows == (("x", 1.0), ("y", 2.0), ("y", 3.0))
    assert whole.notes == ("n",)


def test_tables_of_another_form_are_not_gathered(runner):
    parts = Collection[Table](items={"x": table((1.0,)), "y": table((2.0,), column="b")})
    with pytest.raises(RuleError, match="the columns of `y` differ from those of `x`"):
        runner.run("benchmark.gather", tables=parts)
    with pytest.raises(RuleError, match="no tables were given"):
        runner.run("benchmark.gather", tables=Collection[Table](items={}))


def test_rest_says_who_rests(runner):
    bodies = (
        Settled(name="a", drift_m=0.001, tilt_rad=0.0, penetration_m=0.0, resting=True),
        Settled(name="b", drift_m=1.0, tilt_rad=np.pi, penetration_m=0.002, resting=False),
    )
    report = SettleReport(bodies=bodies, seconds=3.0, energy_j=np.zeros(2), passed=False)
    made = runner.run("benchmark.settle_table", settled=report)
    assert made.rows[0] == ("a", 1.0, 0.0, 0.0, "yes")
    assert made.rows[1][1:] == (1000.0, pytest.approx(180.0), 2.0, "no")
    assert runner.outcome.line == "1 of 2 bodies rest"
