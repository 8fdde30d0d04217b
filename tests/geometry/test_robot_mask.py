"""Pixels on a robot by rendered and measured depth."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import robot_mask


def test_pixels_near_the_outline_and_the_depth_are_the_robots() -> None:
    rendered, labels = np.zeros((20, 30)), np.zeros((20, 30), np.int32)
    rendered[5:15, 10:20], labels[5:15, 10:15], labels[5:15, 15:20] = 1.0, 1, 2
    measured = np.full((20, 30), 1.5)
    measured[5:15, 12:22] = 1.01  # the robot is two pixels further to the right
    found = robot_mask.near(rendered, labels, measured, 0.03, 3)
    assert (found[5:15, 12:15] == 1).all()
    assert (found[5:15, 15:22] == 2).all()
    assert (found > 0).sum() == 100
    assert (robot_mask.near(rendered, labels, measured, 0.03, 1)[5:15, 21] == 0).all()
    assert not robot_mask.near(rendered, np.zeros_like(labels), measured, 0.03, 3).any()


def test_inner_pixels_have_neighbours_of_their_part_and_depth() -> None:
    labels, depth = np.zeros((12, 12), np.int32), np.ones((12, 12))
    labels[2:10, 2:10] = 1
    labels[2:10, 6:10] = 2
    depth[2:6] = 1.2
    found = robot_mask.inner(labels, depth)
    assert not found[:, [5, 6]].any()
    assert not found[[5, 6]].any()
    assert found[4, 4]
    assert found.sum() == 2 * 2 * 2 * 2
