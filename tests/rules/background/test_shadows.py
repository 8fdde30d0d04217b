"""Shadows of removed things."""

from __future__ import annotations

import numpy as np

from rules.background.static_planes import _gain


def test_a_shadow_that_the_pictures_border_cuts_is_removed_up_to_the_border() -> None:
    flat = np.full((160, 200, 3), 180.0, np.float32)
    outside = np.zeros(flat.shape[:2], bool)
    outside[120:] = True
    gap, shadow = np.zeros_like(outside), np.zeros_like(outside)
    gap[70:100, 80:120] = True
    shadow[100:120, 80:120] = True
    flat[shadow] *= 0.75
    flat[outside] = 0.0
    gain = _gain(flat, gap, ~gap & ~outside, np.zeros_like(gap), outside, 40.0)
    # The shadow's edges are soft.
    inner = np.s_[102:120, 90:110]
    assert np.abs((flat * gain)[inner] - 180.0).max() < 6.0
    away = ~gap & ~outside
    away[40:, 20:180] = False
    np.testing.assert_allclose((flat * gain)[away], 180.0, atol=0.5)


def test_a_brighter_board_beside_a_removed_thing_keeps_its_brightness() -> None:
    """The far boards of a kitchen table became as dark as the near ones, up to 100 mm from each thing on it."""
    flat = np.full((160, 200, 3), 150.0, np.float32)
    flat[:50, 60:140] = 200.0
    gap = np.zeros(flat.shape[:2], bool)
    gap[40:70, 80:120] = True
    nothing = np.zeros_like(gap)
    gain = _gain(flat, gap, ~gap, nothing, nothing, 30.0)
    assert gain[~gap].min() > 0.92
