"""evaluate.expert: one row of the attempts of an operator."""

from __future__ import annotations

import pytest

from dextera_build.statistics import wilson
from dextera_build.testing import RuleRunner
from tests import episodes


def test_a_row_has_the_rate_over_all_attempts_and_the_kinds_of_failures(tmp_path):
    made = episodes.small(count=2)
    lost = next(iter(made.failures.values()))
    why = ("misses it by 3 mm and 4 deg in `grasp`", "misses it by 20 mm and 11 deg in `grasp`", "box: not lifted")
    failures = {f"lost_{number}": lost.model_copy(update={"reason": reason}) for number, reason in enumerate(why)}
    made = made.model_copy(update={"failures": failures, "attempts": 5})
    table = RuleRunner(tmp_path).run(
        "evaluate.expert", profile="stub", bundle=episodes.bundle(), episodes=made, options={"measured": 5}
    )
    row = dict(zip((column.name for column in table.columns), table.rows[0], strict=True))
    low, high = wilson(2, 5)
    assert row["attempts"] == 5
    assert [row["success"], row["low"], row["high"]] == pytest.approx([40.0, 100 * low, 100 * high])
    assert (row["return"], row["random return"]) == (pytest.approx(0.4), 0.0)
    assert row["failures"] == "2 x misses it by N mm and N deg in `grasp`, 1 x box: not lifted"
