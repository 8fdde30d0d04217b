"""Upright boxes: recovered at any yaw."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry.boxes import upright_box


@pytest.mark.parametrize("yaw", [0.0, 0.3, 1.2, 2.9])
def test_a_turned_box_is_recovered(yaw):
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (0, 0.3) for y in (0, 0.1) for z in (0, 0.2)])
    inside = rng.uniform([0, 0, 0], [0.3, 0.1, 0.2], (200, 3))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    edges, angle = upright_box(np.concatenate([corners, inside]) @ turn.T)
    assert edges == pytest.approx([0.3, 0.1, 0.2])
    assert np.sin(angle - yaw) == pytest.approx(0.0, abs=1e-9)
