"""The transfer function of sRGB."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import colour


def test_there_and_back():
    shades = np.linspace(0, 1, 1001)
    assert np.abs(colour.to_srgb(colour.to_linear(shades)) - shades).max() < 1e-6


def test_known_values():
    assert colour.to_linear(np.array([0.0, 0.04, 0.5, 1.0])) == pytest.approx([0, 0.04 / 12.92, 0.21404114, 1])
    assert colour.to_srgb(np.array([-1.0, 2.0])).tolist() == [0.0, pytest.approx(1.0)]
