"""Poses of tracked objects."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import lie, transforms
from dextera_build.tracking import motions


def test_products_that_are_rounded_off_become_rotations_again():
    off = transforms.rigid(lie.rotation(np.array([0.1, 0.2, 0.3])) * 1.001, np.ones(3))
    made = motions.proper(off)
    assert made[:3, :3] @ made[:3, :3].T == pytest.approx(np.eye(3))


def test_the_way_of_points_includes_the_rotation():
    """A turn of a long thing about its middle is a motion, though its origin stays."""
    corners = np.array([(1.0, 0, 0), (-1.0, 0, 0)])
    turned = transforms.rigid(lie.rotation(np.array([0, 0, 0.01])), np.zeros(3))
    assert motions.displacement(np.eye(4), turned, corners) == pytest.approx(0.01, rel=1e-3)
