"""Which samples a batch holds."""

from __future__ import annotations

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pytest

from dextera_build.errors import RuleError
from dextera_build.learning.sampling import Balanced, Deck


def test_300_simulated_and_30_recorded_are_shown_one_to_one():
    """Joined and shuffled they would stand ten to one."""
    balanced = Balanced(300, 30, batch=20, seed=0)
    assert balanced.epoch == 3
    simulated, recorded = np.zeros(300, int), np.zeros(30, int)
    for _ in range(10 * balanced.epoch):
        first, second = balanced.draw()
        assert len(first) == len(second) == 10
        assert len(set(first.tolist())) == len(set(second.tolist())) == 10
        np.add.at(simulated, first, 1)
        np.add.at(recorded, second, 1)
    assert (recorded == 10).all(), "ten epochs show each sample of the smaller domain ten times"
    assert (simulated == 1).all(), "and each sample of a ten times larger domain once"


def test_an_epoch_shows_the_smaller_domain_once():
    balanced = Balanced(300, 30, batch=20, seed=3)
    for _ in range(5):
        shown = np.concatenate([balanced.draw()[1] for _ in range(balanced.epoch)])
        assert sorted(shown.tolist()) == list(range(30))


def test_the_order_differs_between_epochs_seeds_and_domains():
    def first_epoch(seed: int) -> tuple[list[int], list[int]]:
        left, right = Balanced(40, 40, batch=80, seed=seed).draw()
        return left.tolist(), right.tolist()

    again = Balanced(40, 40, batch=80, seed=0)
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


def test_an_odd_batch_cannot_be_balanced():
    with pytest.raises(RuleError, match="a batch of 21 cannot hold as many samples of one domain") as caught:
        Balanced(300, 30, batch=21, seed=0)
    assert caught.value.hint == "use 22"


def test_half_a_batch_fits_into_the_smaller_domain():
    with pytest.raises(RuleError, match="half a batch is 32, but a domain has 30 samples") as caught:
        Balanced(300, 30, batch=64, seed=0)
    assert caught.value.hint == "use batches of 60 or smaller"


def test_a_draw_that_is_too_large_is_refused():
    with pytest.raises(RuleError, match="a draw of 4 cannot be made from 3 samples without repeating one"):
        Deck(3, 0).draw(4)
