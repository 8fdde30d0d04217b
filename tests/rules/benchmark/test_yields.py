"""benchmark.yields: what data sets took."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.errors import RuleError
from dextera_build.geometry.plot import COLOURS
from dextera_build.testing import RuleRunner
from tests import episodes


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def test_attempts_reasons_and_lengths(runner):
    found = episodes.small(3, 20)
    table = runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    names = [column.name for column in table.columns]
    (row,) = (dict(zip(names, row, strict=True)) for row in table.rows)
    assert (row["episodes"], row["task"], row["world"], row["actor"]) == ("demos", "LiftBox", "twin", "operator")
    assert (row["attempts"], row["successes"], row["yield"]) == (4, 3, 75.0)
    assert row["low"] == pytest.approx(30.1, abs=0.1)
    assert row["mean length"] == 1.0
    assert row["sorted out"] == "1 x box: not lifted"
    assert runner.outcome.line == "3 episodes from 4 attempts (75 %)"


def test_starts_are_dots_on_a_map_and_actions_curves(runner):
    found = episodes.small(3, 20)
    # The box of the lost attempt stood a metre away.
    (name, lost), *_ = found.failures.items()
    far = episodes.observed(lost, objects=lost.objects + np.float32(np.eye(7)[0]))
    rows = {name: getattr(lost, name)[:0] for name in ("action", "executed", "hand")}
    empty = episodes.observed(lost, **{name: values[:0] for name, values in lost.terms.items()})
    empty = empty.model_copy(update={"reason": "no start", **rows})
    found = found.model_copy(update={"failures": {name: far, "5": empty}, "attempts": 5})
    runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    (where, dots), (curves, lines) = runner.outcome.previews
    assert where == "demos: starts of box in the base, kept (blue) and discarded (orange)"
    assert sorted(curves.removeprefix("demos: targets of ").split(", ")) == ["joint_1", "joint_2", "joint_3"]
    pixels = np.asarray(Image.open(io.BytesIO(dots)).convert("RGB")).astype(int)
    blue, orange = (np.argwhere((pixels == colour).all(axis=2)) for colour in COLOURS[:2])
    assert 1 <= len(blue) <= 3 * 25
    assert 1 <= len(orange) <= 25, "one discarded start, and none of the attempt without a step"
    assert orange[:, 1].min() > blue[:, 1].max() + 100, "x is to the right"
    drawn = np.asarray(Image.open(io.BytesIO(lines)).convert("RGB")).astype(int)
    assert all((drawn == colour).all(axis=2).any() for colour in COLOURS[:3])


def test_attempts_that_were_not_kept_are_counted(runner):
    found = episodes.small(3, 20).model_copy(update={"attempts": 10})
    table = runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    assert table.rows[0][-1] == "6 x not kept, 1 x box: not lifted"


def test_a_data_set_without_a_success_still_has_a_row(runner):
    found = episodes.small(3, 20).model_copy(update={"items": {}})
    table = runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    assert table.rows[0][5:7] == (0, 0.0)
    assert table.rows[0][9] is None


def test_impossible_counts_and_nothing_are_refused(runner):
    wrong = episodes.small(3, 20).model_copy(update={"attempts": 2})
    with pytest.raises(RuleError, match="`demos` has more episodes than attempts"):
        runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": wrong}))
    with pytest.raises(RuleError, match="there are no episodes"):
        runner.run("benchmark.yields", episodes=Collection[Episodes](items={}))
