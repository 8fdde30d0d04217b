"""Curves without overshoot: the same as those of SciPy, digit by digit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from dextera_build.geometry import curves


@pytest.mark.parametrize("seed", range(30))
def test_values_are_those_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 12))
    x = np.cumsum(rng.uniform(0.01, 1.0, count))
    y = np.round(rng.normal(size=count), 1 + seed % 3)  # also equal neighbours
    at = np.concatenate([x, rng.uniform(x[0], x[-1], 50)])
    assert (curves.monotone(x, y, at) == PchipInterpolator(x, y)(at)).all()


def test_a_curve_rises_only_where_its_points_do() -> None:
    x, y = np.arange(5.0), np.array([0.0, 1.0, 1.0, 5.0, 5.1])
    values = curves.monotone(x, y, np.linspace(0.0, 4.0, 200))
    assert (np.diff(values) >= -1e-12).all()
    assert values.max() == pytest.approx(5.1)
    with pytest.raises(ValueError, match="do not increase"):
        curves.monotone(np.array([0.0, 1.0, 1.0]), y[:3], x)
