"""Heights of what is below the corners of a body, and whether it carries them."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry.convex import Convex
from dextera_build.sim.model.footing import carry, floor

WEDGE = np.array([[x, y, z] for x, z in ((0.0, 0.0), (0.1, 0.0), (0.1, 0.04)) for y in (-0.1, 0.1)])
CORNERS = np.array([[x, y, 0.1] for x in (-0.05, 0.05) for y in (-0.05, 0.05)])


def test_the_floor_is_the_highest_surface_below() -> None:
    points = np.array([[0.025, 0.0, 0.08], [0.1, 0.05, 0.08], [0.2, 0.0, 0.08], [0.05, 0.0, 0.01], [0.05, 0.0, 0.017]])
    heights = floor(points, [Convex(WEDGE)], 0.006)
    np.testing.assert_allclose(heights, [0.01, 0.04, 0.0, 0.0, 0.02], atol=1e-9)


def test_of_two_pieces_the_higher_one_counts() -> None:
    tall = WEDGE * [1.0, 1.0, 2.0]
    for pieces in ([WEDGE, tall], [tall, WEDGE]):
        found = floor(np.array([[0.05, 0.0, 0.5]]), [Convex(each) for each in pieces], 0.0)
        np.testing.assert_allclose(found, [0.04], atol=1e-9)


def test_corners_carry_if_they_surround_the_middle() -> None:
    assert carry(CORNERS, np.array([True, True, True, True]))
    assert not carry(CORNERS, np.array([True, True, False, False]))
    assert not carry(CORNERS, np.array([False, False, False, False]))
