"""benchmark.yields: what data sets took."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.errors import RuleError
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
    assert (row["episodes"], row["task"], row["actor"]) == ("demos", "LiftBox", "operator")
    assert (row["attempts"], row["successes"], row["yield"]) == (4, 3, 75.0)
    assert row["low"] == pytest.approx(30.1, abs=0.1)
    assert row["mean length"] == 1.0
    assert row["sorted out"] == "1 x box: not lifted"
    assert runner.outcome.line == "3 episodes from 4 attempts (75 %)"


def test_attempts_that_were_not_kept_are_counted(runner):
    found = episodes.small(3, 20).model_copy(update={"attempts": 10})
    table = runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    assert table.rows[0][-1] == "6 x not kept, 1 x box: not lifted"


def test_a_data_set_without_a_success_still_has_a_row(runner):
    found = episodes.small(3, 20).model_copy(update={"items": {}})
    table = runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": found}))
    assert table.rows[0][4:6] == (0, 0.0)
    assert table.rows[0][8] is None


def test_impossible_counts_and_nothing_are_refused(runner):
    wrong = episodes.small(3, 20).model_copy(update={"attempts": 2})
    with pytest.raises(RuleError, match="`demos` has more episodes than attempts"):
        runner.run("benchmark.yields", episodes=Collection[Episodes](items={"demos": wrong}))
    with pytest.raises(RuleError, match="there are no episodes"):
        runner.run("benchmark.yields", episodes=Collection[Episodes](items={}))
