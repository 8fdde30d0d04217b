"""A surface that was seen to end does not go on past its end; one that is cut does."""

from __future__ import annotations

import numpy as np

from rules.background.ends import border, limits

SIZE = (60, 80)


def test_a_cupboard_goes_on_below_a_table_and_not_beside_itself() -> None:
    own = np.zeros(SIZE, bool)
    own[10:40, 20:50] = True
    seen = np.full(SIZE, 3.0)  # a wall
    seen[40:] = 1.0  # a table before it
    seen[own] = 2.0
    depth = np.full(SIZE, 2.0)
    around = border(own, seen, depth)
    assert around.goes_on[around.nearest[45, 30]]
    assert not around.goes_on[around.nearest[20, 55]]
    rows, columns = np.indices(SIZE)
    places = np.stack([columns * 0.01, -rows * 0.01], axis=-1)
    low, high = limits(around, own, places)
    assert low[1] == -np.inf, "its lower end is hidden"
    np.testing.assert_allclose([low[0], high[0], high[1]], [0.2, 0.49, -0.1], atol=0.011)


def test_a_wall_behind_things_has_no_ends() -> None:
    own = np.ones(SIZE, bool)
    own[20:40, 30:50] = False
    seen = np.where(own, 3.0, 1.0)
    around = border(own, seen, np.full(SIZE, 3.0))
    rows, columns = np.indices(SIZE)
    low, high = limits(around, own, np.stack([columns * 0.01, -rows * 0.01], axis=-1))
    assert np.isinf([*low, *high]).all()
