"""Which samples a batch holds."""

from __future__ import annotations

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.learning.sampling import Deck, Mixed


def test_300_simulated_and_30_recorded_are_shown_one_to_one():
    """Joined and shuffled they would stand ten to one."""
    mixed = Mixed((300, 30), (1, 1), batch=20, seed=0)
    assert mixed.epoch == 3
    simulated, recorded = np.zeros(300, int), np.zeros(30, int)
    for _ in range(10 * mixed.epoch):
        first, second = mixed.draw()
        assert len(first) == len(second) == 10
        assert len(set(first.tolist())) == len(set(second.tolist())) == 10
        np.add.at(simulated, first, 1)
        np.add.at(recorded, second, 1)
    assert (recorded == 10).all(), "ten epochs show each sample of the smaller part ten times"
    assert (simulated == 1).all(), "and each sample of a ten times larger part once"


@hypothesis.given(
    parts=st.lists(st.tuples(st.integers(20, 60), st.integers(1, 4)), min_size=1, max_size=4),
    times=st.integers(1, 5),
    seed=st.integers(0, 9),
)
def test_every_batch_is_divided_exactly_by_the_weights(parts: list[tuple[int, int]], times: int, seed: int):
    sizes, weights = zip(*parts, strict=True)
    mixed, seen = Mixed(sizes, weights, times * sum(weights), seed), [np.zeros(size, int) for size in sizes]
    for _ in range(7):
        drawn = mixed.draw()
        assert [len(each) for each in drawn] == [times * weight for weight in weights]
        for each, count in zip(drawn, seen, strict=True):
            np.add.at(count, each, 1)
    assert all(count.max() - count.min() <= 1 for count in seen), "no sample comes twice before all others came"


def test_an_epoch_shows_the_part_that_is_used_up_first_once():
    mixed = Mixed((300, 30), (1, 1), batch=20, seed=3)
    for _ in range(5):
        shown = np.concatenate([mixed.draw()[1] for _ in range(mixed.epoch)])
        assert sorted(shown.tolist()) == list(range(30))


def test_the_order_differs_between_epochs_seeds_and_parts():
    def first_epoch(seed: int) -> tuple[list[int], list[int]]:
        left, right = Mixed((40, 40), (1, 1), batch=80, seed=seed).draw()
        return left.tolist(), right.tolist()

    again = Mixed((40, 40), (1, 1), batch=80, seed=0)
    assert again.draw()[0].tolist() != again.draw()[0].tolist()
    assert first_epoch(0) == first_epoch(0)
    assert first_epoch(0) != first_epoch(1)
    assert first_epoch(0)[0] != first_epoch(0)[1]


@hypothesis.given(count=st.integers(1, 40), draws=st.lists(st.integers(0, 40), max_size=30), seed=st.integers(0, 9))
def test_a_deck_repeats_nothing_within_a_draw_and_is_even_over_rounds(count: int, draws: list[int], seed: int):
    deck, seen = Deck(count, seed), np.zeros(count, int)
    for size in draws:
        drawn = deck.draw(min(size, count))
        assert len(set(drawn.tolist())) == len(drawn) == min(size, count)
        np.add.at(seen, drawn, 1)
        assert seen.max() - seen.min() <= 1


def test_a_batch_that_the_weights_do_not_divide_is_refused():
    with pytest.raises(RuleError, match="a batch of 21 cannot be divided 3 : 1 between the parts") as caught:
        Mixed((300, 30), (3, 1), batch=21, seed=0)
    assert caught.value.hint == "use 24"


def test_a_batch_that_a_part_is_too_small_for_is_refused():
    with pytest.raises(RuleError, match="a batch needs 32 samples of a part of the mixture that has 30") as caught:
        Mixed((300, 30), (1, 1), batch=64, seed=0)
    assert caught.value.hint == "use batches of 60 or smaller"


def test_a_draw_that_is_too_large_is_refused():
    with pytest.raises(RuleError, match="a draw of 4 cannot be made from 3 samples without repeating one"):
        Deck(3, 0).draw(4)
