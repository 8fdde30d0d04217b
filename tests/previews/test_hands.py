"""The film of hands: one picture per moment, both hands where they are, and words about what is lost or made."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.previews import hands
from tests.hand_streams import stream


def coloured(picture: np.ndarray, panel: int) -> np.ndarray:
    """Columns of a panel in which something is drawn in colour, above the time line."""
    view = picture[30 : hands.PANEL[1], panel * hands.PANEL[0] : (panel + 1) * hands.PANEL[0]].astype(int)
    return np.flatnonzero((np.ptp(view, axis=2) > 60).any(axis=0))


def test_a_film_has_a_picture_per_moment_in_which_the_hands_move() -> None:
    made = list(hands.frames(stream(72), 12.0))
    assert len(made) == 12
    assert {picture.shape for picture in made} == {(hands.PANEL[1] + 44, 2 * hands.PANEL[0], 3)}
    assert len(list(hands.frames(stream(72), 12.0, most_s=0.25))) == 4
    assert abs(coloured(made[0], 0).mean() - coloured(made[6], 0).mean()) > 2


def test_the_left_hand_is_on_the_left_seen_from_behind() -> None:
    made = list(hands.frames(stream(20, lost=[(0, 10, 20)]), 72.0))
    middle = hands.PANEL[0] / 2
    assert coloured(made[5], 0).min() < middle < coloured(made[5], 0).max()
    assert coloured(made[15], 0).min() > middle


@pytest.mark.parametrize("changes", [{"lost": [(0, 0, 9), (1, 0, 9)]}, {"head": None}, {}])
def test_there_is_a_strip_of_every_stream(changes: dict) -> None:
    assert hands.strip(stream(9, **changes), 3).shape[0] == 3 * (hands.PANEL[1] + 44)


def test_facts_say_what_a_program_made() -> None:
    assert "made by a program, no person and no headset (a test, no headset)" in list(stream(9).facts())
    assert list(stream(9, synthetic=False, device="headset").facts())[-1] == "headset"
    assert "no left hand" in list(stream(9, lost=[(0, 0, 9)]).facts())


def test_pictures_of_made_hands_say_so() -> None:
    made, real = (next(hands.frames(stream(9, synthetic=synthetic))) for synthetic in (True, False))
    words = np.s_[14:30, : hands.PANEL[0]]
    assert (made[words] != real[words]).any()
    assert (made[30:] == real[30:]).all()
