"""Pinches of a human hand: tips as far apart as asked, within the limits of the joints."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_pinch import pinching


@pytest.mark.parametrize("length_m", [0.16, 0.21])
@pytest.mark.parametrize("apart_m", [0.008, 0.03])
@pytest.mark.parametrize("finger", hands.FINGERS[1:])
def test_tips_are_as_far_apart_as_asked(finger: str, apart_m: float, length_m: float) -> None:
    hand = human_hand.Hand(length_m, 0.45 * length_m)
    angles = pinching(finger, apart_m, hand)
    points, _ = hand.joints(angles, "left")
    assert hands.pinch_distance(points, finger) == pytest.approx(apart_m, abs=1e-4)
    degrees = np.rad2deg(angles)
    assert (degrees >= human_hand.LIMITS_DEG[..., 0] - 1e-9).all()
    assert (degrees <= human_hand.LIMITS_DEG[..., 1] + 1e-9).all()
    others = [place for place, name in enumerate(hands.FINGERS) if name not in ("thumb", finger)]
    np.testing.assert_array_equal(angles[others], human_hand.open_angles()[others])
