"""The paper's tables against the paper's own sums."""

from __future__ import annotations

import pytest

from dextera_build.statistics import mean
from rules.evaluate import published

MEANS = {
    "ACT": (58.3, 54.2),
    "DP": (45.8, 37.3),
    "BC-RNN": (22.0, 11.2),
    "OpenVLA": (28.4, 13.8),
    "pi0.5": (64.8, 56.5),
    "T-S": (44.5, 17.3),
}


@pytest.mark.parametrize("policy", MEANS)
def test_its_means_are_those_that_it_prints(policy):
    for side in (0, 1):
        middle, _, _ = mean([row[policy][side] for row in published.POLICY.values()])
        assert 100 * middle == pytest.approx(MEANS[policy][side], abs=0.051)


def test_thirteen_pairs_of_twelve_tasks():
    assert published.POLICY.keys() == published.REPLAY.keys()
    assert len(published.POLICY) == 13
    assert len({task for _, task in published.POLICY}) == 12


def test_replays_add_up():
    assert sum(rate.successes for rate in published.REPLAY.values()) == 343
    assert sum(rate.trials for rate in published.REPLAY.values()) == 390
    assert sum(rate.value == 1 for rate in published.REPLAY.values()) == 4


def test_cells_are_whole_numbers_of_trials():
    for row in published.POLICY.values():
        for simulated, measured in row.values():
            assert (simulated.trials, measured.trials) == (100, 20)
    assert published.POLICY["KL", "LiftMustardBottle"]["ACT"][1].successes == 7
