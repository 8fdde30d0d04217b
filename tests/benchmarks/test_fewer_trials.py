"""Tests and intervals of success rates hold what they promise on verdicts drawn from known rates."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks import fewer_trials
from tests.benchmarks.fewer_trials import ALPHA, chances, sequential, wins

RUNS = 4000


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def test_chances_are_those_of_the_rates():
    for twin, other, shared in fewer_trials.grid():
        cells = chances(twin, other, shared)
        assert cells.sum() == pytest.approx(1.0)
        assert (cells[0] + cells[1], cells[0] + cells[2]) == (pytest.approx(twin), pytest.approx(other))


def test_equal_sides_are_rarely_told_apart_however_long_one_looks():
    assert 0.02 < fewer_trials.error(200) <= ALPHA


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "shared"), [(0.5, 0.0), (0.9, 0.0), (0.7, 0.6)])
def test_stopping_at_the_first_decision_is_rarely_wrong(rng, rate, shared):
    done, used = sequential(*wins(chances(rate, rate, shared), 150, RUNS, rng))
    assert done.mean() <= ALPHA
    assert used[~done].min() == 150


def test_a_p_value_that_is_looked_at_again_and_again_is_wrong_more_often(rng):
    """What the e-value is for: the same data, stopped as soon as McNemar's p is small."""
    first, second = wins(chances(0.5, 0.5, 0.0), 150, 1000, rng)
    looks = fewer_trials.fixed(first, second)
    assert looks.any(axis=1).mean() > 2 * ALPHA
    assert looks[:, -1].mean() <= ALPHA + 0.01


def test_a_clear_difference_takes_a_fraction_of_the_starts(rng):
    series = wins(chances(0.9, 0.5, 0.0), 100, RUNS, rng)
    done, used = sequential(*series)
    assert done.mean() > 0.99
    assert used.mean() < 30
    assert fewer_trials.fixed(*series)[:, -1].mean() >= done.mean() - 0.01


@pytest.mark.medium
@pytest.mark.parametrize(("pairs", "rest"), [(10, 90), (20, 80), (50, 50)])
def test_joined_intervals_cover_the_truth(rng, pairs, rest):
    found = np.array([fewer_trials.estimate(chances(*case), pairs, rest, 500, rng) for case in fewer_trials.grid()])
    assert found[:, 0].mean() >= 0.94
    assert found[:, 0].min() >= 0.90, "Wilson's own least coverage is 0.92, with an error of 0.01 here"
    assert (found[:, 1] <= 1.05 * found[:, 3]).all()


def test_a_twin_that_tells_the_other_world_saves_trials_and_one_that_does_not_saves_none(rng):
    tells = fewer_trials.estimate(chances(0.7, 0.7, 0.9), 50, 200, 1000, rng)
    knows_nothing = fewer_trials.estimate(chances(0.7, 0.7, 0.0), 50, 200, 1000, rng)
    assert tells[4] > 40
    assert tells[1] < 0.8 * tells[3]
    assert knows_nothing[4] < 2
    assert min(tells[0], knows_nothing[0]) > 0.93


@pytest.mark.parametrize("rate", [0.5, 0.9])
def test_a_confidence_sequence_holds_at_all_times_at_once(rng, rate):
    assert fewer_trials.always(rate, 60, RUNS, rng) >= 0.95


def test_the_interval_of_progress_covers_its_mean(rng):
    for shares in ((0.1, 0.1, 0.2, 0.2, 0.4), (0.0, 0.5, 0.0, 0.0, 0.5), (0.5, 0.3, 0.1, 0.1, 0.0)):
        assert fewer_trials.mean_progress(shares, 20, 2000, rng) >= 0.94
