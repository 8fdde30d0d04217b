"""Statistics of success: known values, axioms, and that intervals cover as often as they say."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build import statistics
from dextera_build.statistics import Paired, Rate

RATES = st.lists(st.floats(0, 1), min_size=2, max_size=12)
COUNTS = st.integers(1, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(11, 20, 34.2, 74.2), (343, 390, 84.3, 90.8), (0, 10, 0.0, 27.8), (10, 10, 72.2, 100.0), (93, 100, 86.3, 96.6)],
)
def test_wilson_intervals_that_are_known(successes, trials, low, high):
    assert 100 * np.array(statistics.wilson(successes, trials)) == pytest.approx([low, high], abs=0.05)


@given(COUNTS)
def test_a_wilson_interval_holds_the_rate_and_mirrors(count):
    successes, trials = count
    low, high = statistics.wilson(successes, trials)
    assert 0 <= low <= successes / trials <= high <= 1
    mirrored = statistics.wilson(trials - successes, trials)
    assert mirrored == pytest.approx((1 - high, 1 - low))
    wider = statistics.wilson(successes, trials, 0.99)
    assert wider[0] <= low <= high <= wider[1]


@given(COUNTS)
def test_more_trials_narrow_it(count):
    successes, trials = count
    few, many = (statistics.wilson(k * successes, k * trials) for k in (1, 4))
    assert many[1] - many[0] < few[1] - few[0]


def test_without_trials_nothing_is_known():
    assert statistics.wilson(0, 0) == (0.0, 1.0)
    assert Rate(0, 0).value == 0.0


def test_a_rate_reads_as_people_write_it():
    assert str(Rate(93, 100)) == "93/100 (86-97 %)"


def test_the_interval_covers_the_true_rate_as_often_as_it_says():
    for rate in (0.5, 0.88, 0.97):
        chances = [math.comb(50, k) * rate**k * (1 - rate) ** (50 - k) for k in range(51)]
        ends = [statistics.wilson(k, 50) for k in range(51)]
        covered = sum(chance for chance, (low, high) in zip(chances, ends, strict=True) if low <= rate <= high)
        assert covered == pytest.approx(0.95, abs=0.025)


def test_the_mean_counts_every_task_the_same():
    few, many = Rate(10, 20), Rate(400, 400)
    assert statistics.mean([few, many])[0] == 0.75
    assert statistics.mean([]) is None
    assert statistics.mean([few])[1:] == pytest.approx(few.interval())


@given(st.lists(COUNTS, min_size=1, max_size=8))
def test_the_interval_of_a_mean_is_narrower_than_the_widest_and_holds_the_mean(counts):
    rates = [Rate(*count) for count in counts]
    middle, low, high = statistics.mean(rates)
    assert 0 <= low <= middle <= high <= 1
    assert high - low <= max(b - a for a, b in (rate.interval() for rate in rates)) + 1e-9


def test_the_interval_of_a_mean_covers_it():
    rng = np.random.default_rng(0)
    truth = np.array([0.3, 0.9, 0.6])
    hits = 0
    for _ in range(1000):
        _, low, high = statistics.mean([Rate(int(k), 50) for k in rng.binomial(50, truth)])
        hits += low <= truth.mean() <= high
    assert 930 <= hits <= 975


@given(RATES, st.floats(0.1, 5), st.floats(-2, 2))
def test_pearson_is_numpy_s_and_knows_no_scale(values, scale, shift):
    other = np.sin(7 * np.arange(len(values)))
    r = statistics.pearson(values, other)
    if len(values) < 3 or np.std(values) < 1e-6:
        return
    assert r == pytest.approx(np.corrcoef(values, other)[0, 1], abs=1e-6)
    assert statistics.pearson(scale * np.array(values) + shift, other) == pytest.approx(r, abs=1e-6)
    assert statistics.pearson(other, values) == pytest.approx(r)


def test_too_little_has_no_correlation():
    assert statistics.pearson([0.1, 0.9], [0.2, 0.8]) is None
    assert statistics.pearson([0.5, 0.5, 0.5], [0.1, 0.2, 0.3]) is None
    assert statistics.pearson_interval(0.9, 3) is None
    assert statistics.pearson_interval(1.0, 10) is None


@pytest.mark.parametrize("function", [statistics.pearson, statistics.mmrv, statistics.paired])
def test_sides_of_different_length_are_refused(function):
    with pytest.raises(ValueError, match="stand against"):
        function([0.1, 0.2, 0.3], [0.1, 0.2])


def test_fisher_s_interval_is_the_one_of_the_books():
    low, high = statistics.pearson_interval(0.7, 28)
    assert (low, high) == pytest.approx((math.tanh(0.8673 - 1.96 / 5), math.tanh(0.8673 + 1.96 / 5)), abs=1e-4)


@given(RATES)
def test_equal_ranks_violate_nothing(values):
    assert statistics.mmrv(values, values) == 0.0
    assert statistics.mmrv(np.array(values) / 2, values) in (0.0, pytest.approx(0.0, abs=1e-300))


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=2, max_size=8))
def test_mmrv_is_its_formula(points):
    s, r = zip(*points, strict=True)
    worst = [
        max(abs(r[i] - r[j]) * ((s[i] > s[j]) != (r[i] > r[j])) for j in range(len(points))) for i in range(len(points))
    ]
    assert statistics.mmrv(s, r) == pytest.approx(sum(worst) / len(worst))


def test_a_swapped_pair_costs_its_distance():
    assert statistics.mmrv([0.2, 0.8], [0.9, 0.4]) == pytest.approx(0.5)
    assert statistics.mmrv([0.5], [0.5]) is None


def test_a_tie_violates_the_rank_of_the_better_one_as_in_simplers_code():
    assert statistics.mmrv([0.5, 0.5, 0.5], [0.0, 0.1, 1.0]) == pytest.approx((0.0 + 0.1 + 1.0) / 3)
    assert statistics.mmrv([0.2, 0.8], [0.5, 0.5]) == 0.0


def test_paired_verdicts_are_counted_start_by_start():
    assert statistics.paired([1, 1, 0, 0, 1], [1, 0, 1, 0, 0]) == Paired(both=1, first=2, second=1, neither=1)


@pytest.mark.medium
@pytest.mark.parametrize("cells", [(0.5, 0.2, 0.1, 0.2), (0.05, 0.4, 0.05, 0.5), (0.85, 0.1, 0.05, 0.0)])
def test_the_interval_of_a_paired_difference_holds_the_truth_as_often_as_it_says(cells):
    draws = np.random.default_rng(0).multinomial(20, cells, size=4000)
    found = np.array([Paired(*map(int, draw)).difference() for draw in draws])
    held = (found[:, 1] <= cells[1] - cells[2]) & (cells[1] - cells[2] <= found[:, 2])
    assert 0.93 <= held.mean() <= 0.995


def test_the_example_of_newcombe():
    """The first example of his comparison of methods for paired data (1998)."""
    assert Paired(36, 12, 2, 0).difference() == pytest.approx((0.2, 0.0569, 0.3404), abs=1e-4)


def test_pairs_that_agree_narrow_the_interval_of_their_difference():
    alike, unlike = Paired(8, 4, 0, 8).difference(), Paired(4, 8, 4, 4).difference()
    assert alike[0] == pytest.approx(unlike[0]) == 0.2
    assert alike[2] - alike[1] < 0.75 * (unlike[2] - unlike[1])
    assert Paired(0, 0, 0, 0).difference() == (0.0, -1.0, 1.0)
    one, other = Paired(5, 3, 1, 1), Paired(5, 1, 3, 1)
    assert one.difference()[0] == -other.difference()[0]
    assert one.difference()[1] == pytest.approx(-other.difference()[2])
    middle, low, high = statistics.mean_difference([one] * 4)
    assert middle == one.difference()[0]
    assert high - low == pytest.approx((one.difference()[2] - one.difference()[1]) / 2)


@pytest.mark.parametrize(("first", "second", "p"), [(0, 0, 1.0), (3, 3, 1.0), (6, 0, 2 / 64), (10, 2, 0.03857421875)])
def test_mcnemar_s_exact_p(first, second, p):
    assert Paired(50, first, second, 50).p == pytest.approx(p)
    assert Paired(0, second, first, 0).p == Paired(50, first, second, 50).p


def test_mcnemar_is_rarely_wrong_where_neither_is_better():
    for count in range(1, 12):
        outcomes = itertools.product([True, False], repeat=count)
        wrong = sum(Paired(0, sum(one), count - sum(one), 0).p < 0.05 for one in outcomes)
        assert wrong / 2**count < 0.05


@pytest.mark.parametrize(("wins", "losses", "e"), [(0, 0, 1.0), (1, 0, 1.0), (8, 0, 256 / 9), (3, 3, 64 / 140)])
def test_the_e_value_is_the_mean_wealth_of_all_bets(wins, losses, e):
    assert Paired(50, wins, losses, 9).e == Paired(0, losses, wins, 0).e == pytest.approx(e)
    bets = (np.arange(20_000) + 0.5) / 20_000
    mixed = (2.0 ** (wins + losses) * bets**wins * (1 - bets) ** losses).mean()
    assert Paired(0, wins, losses, 0).e == pytest.approx(mixed, rel=1e-6)


@given(st.integers(1, 12), st.floats(0.05, 0.95))
def test_a_gambler_gains_nothing_where_the_rate_is_true(trials, rate):
    wealth = sum(
        math.comb(trials, k) * rate**k * (1 - rate) ** (trials - k) * statistics.evidence(k, trials, rate)
        for k in range(trials + 1)
    )
    assert wealth == pytest.approx(1.0)


@given(st.floats(0.05, 0.95), st.floats(0, 1))
def test_numbers_between_failure_and_success_bring_no_more(rate, part):
    """Half a success in every trial, mean `rate`: the mean wealth after three trials is at most 1."""
    low, high = rate * part, rate + (1 - rate) * part
    chance = (rate - low) / (high - low) if high > low else 0.0
    wealth = sum(
        math.comb(3, k) * chance**k * (1 - chance) ** (3 - k) * statistics.evidence(k * high + (3 - k) * low, 3, rate)
        for k in range(4)
    )
    assert wealth <= 1.0 + 1e-9


def test_a_difference_is_decided_once_and_stays_so():
    ahead = [True] * 8 + [False] * 8
    assert statistics.decided(ahead, [False] * 8 + [True] * 8) == 8
    assert statistics.decided([True, True, *ahead], [True, True, *[False] * 16]) == 10
    assert statistics.decided(ahead[:7], [False] * 7) is None
    assert statistics.decided(ahead[:7], [False] * 7, alpha=0.1) == 7
    with pytest.raises(ValueError, match="shorter"):
        statistics.decided([True], [])


@given(COUNTS)
def test_a_confidence_sequence_is_wider_than_wilson_and_holds_the_rate(count):
    successes, trials = count
    low, high = statistics.confidence_sequence(successes, trials)
    assert 0 <= low <= successes / trials <= high <= 1
    narrow = statistics.wilson(successes, trials)
    assert high - low >= narrow[1] - narrow[0] - 1e-9
    for end in (low, high):
        if 0 < end < 1:
            assert statistics.evidence(successes, trials, end) == pytest.approx(20.0, rel=1e-6)
    assert statistics.Rate(successes, trials, stopped=True).interval() == (low, high)
    assert statistics.confidence_sequence(0, 0) == (0.0, 1.0)


def test_without_other_starts_the_twin_adds_nothing():
    pairs = Paired(10, 3, 2, 5)
    assert statistics.joined(pairs, Rate(0, 0)) == Rate(12, 20)


def test_a_twin_that_agrees_lends_its_trials():
    """All but the added starts agree: the estimate moves towards the twin's rate of all starts."""
    found = statistics.joined(Paired(30, 0, 0, 20), Rate(100, 200))
    assert 0.5 < found.value < 0.6
    assert 100 < found.trials < 250
    assert found.value == pytest.approx((100 + 30) / 250, abs=0.02)


def test_a_twin_without_a_relation_lends_nothing():
    found = statistics.joined(Paired(9, 9, 9, 9), Rate(180, 200))
    assert (found.value, found.trials) == (pytest.approx(0.5), pytest.approx(36))


@given(st.tuples(*[st.integers(0, 30)] * 4), COUNTS)
def test_a_joined_estimate_is_a_rate_of_at_least_its_own_trials(cells, rest):
    found = statistics.joined(Paired(*cells), Rate(*rest))
    low, high = found.interval()
    assert 0 <= low <= found.value <= high <= 1
    assert sum(cells) - 1e-9 <= found.trials <= sum(cells) + rest[1]
