"""Surfaces of the empty scene where nothing was measured."""

from __future__ import annotations

import numpy as np

from rules.background.patch import SUPPORT
from rules.background.patches import divide
from tests import factories


def test_a_floor_goes_on_behind_what_was_removed_from_a_wide_gap() -> None:
    depth = np.full((120, 320), 2.0, np.float32)
    support = np.zeros((120, 320), bool)
    support[90:] = True
    taken = np.zeros_like(support)
    taken[:60, 100:220] = True
    depth[:90, 90:230] = 0.0
    k = factories.camera(320, 240).matrix()
    plane = (np.array([0.0, -0.9, -0.4358899]), 0.8)
    grey = np.full((120, 320, 3), 120, np.uint8)
    labels, patches = divide(grey, depth, k, support, plane, taken, np.zeros_like(taken), 0.03)
    flat = [patch.number for patch in patches if patch.plane is not None and patch.number != SUPPORT]
    assert np.isin(labels[taken], flat).all()
