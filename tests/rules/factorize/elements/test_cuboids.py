"""Whether points are on an upright box."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import solids
from rules.factorize.elements.cuboids import is_box
from tests.rules.factorize.elements.test_nouns import can, lying, oval, points_of


@pytest.mark.parametrize("size", [(0.038, 0.089, 0.175), (0.2, 0.14, 0.05)])
@pytest.mark.parametrize("pitch_deg", [25.0, 50.0])
def test_a_carton_is_a_box(size, pitch_deg):
    _, points, eye = points_of(solids.box(size, (0.0, 0.0, size[2] / 2)), pitch_deg=pitch_deg)
    assert is_box(points, eye)


def test_a_can_is_none_however_it_stands():
    for body in (can(0.033, 0.101), lying(can(0.033, 0.101), 0.033), oval(0.097, 0.07, 0.082)):
        _, points, eye = points_of(body, pitch_deg=50.0)
        assert not is_box(points, eye)


def test_few_points_are_none():
    assert not is_box(np.zeros((10, 3)), np.ones(3))
