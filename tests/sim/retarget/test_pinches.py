"""Pinches: hysteresis, and gaps that follow the operator's."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.retarget.pinches import Pinch, Pinches

THICK = np.array([0.02])


def through(*apart_m: float) -> list[Pinch]:
    made = Pinches(Retargeting(), 1, scale=1.5)
    return [made.next(np.array([each]), THICK) for each in apart_m]


def test_a_pinch_begins_and_ends_at_distances_of_its_own() -> None:
    assert [bool(each.on[0]) for each in through(0.06, 0.04, 0.029, 0.04, 0.049, 0.051, 0.04, 0.031)] == [
        *(False, False),
        *(True, True, True),
        *(False, False, False),
    ]


def test_skins_meet_below_the_closed_distance() -> None:
    for apart in (0.0, 0.008, 0.015):
        [pinch] = through(apart)
        assert pinch.gap_m[0] == 0.0
        assert pinch.share[0] == 1.0


def test_the_gap_grows_evenly_up_to_that_of_a_hand_without_pinch() -> None:
    gaps = [each.gap_m[0] for each in through(0.015, 0.025, 0.035, 0.045, 0.05)]
    assert np.diff(gaps[:4]) == pytest.approx([np.diff(gaps)[0]] * 3)
    assert gaps[-1] == pytest.approx(1.5 * 0.05 - THICK[0])
    assert through(0.05)[0].share[0] == 0.0


def test_fingers_pinch_apart_from_one_another() -> None:
    made = Pinches(Retargeting(), 3, scale=1.0)
    assert made.next(np.array([0.02, 0.06, 0.04]), np.full(3, 0.02)).on.tolist() == [True, False, False]
    assert made.next(np.array([0.06, 0.02, 0.04]), np.full(3, 0.02)).on.tolist() == [False, True, False]
