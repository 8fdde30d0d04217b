"""Edges between planes of the room go on behind removed things."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import cameras
from rules.background.corners import met
from rules.background.patch import SUPPORT

SIZE = (120, 160)
K = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
WALL, FLOOR = 2, 3
FRONT = 4
SUPPORT_PLANE = (np.array([0.0, -1.0, 0.0]), 0.4)
PLANES = {SUPPORT: SUPPORT_PLANE, WALL: (np.array([0.0, 0.0, -1.0]), 3.0), FLOOR: (np.array([0.0, -1.0, 0.0]), 0.7)}
"""A wall 3 m ahead and a floor 0.7 m below, in the camera frame."""


def seen(planes: dict[int, tuple[np.ndarray, float]]) -> np.ndarray:
    """Depth (H, W) of each of the planes where nothing hides it; the nearest first."""
    rays = cameras.rays(*SIZE, K)
    down = [-(rays @ normal) for normal, _ in planes.values()]
    return np.stack([offset / np.maximum(d, 1e-6) for d, (_, offset) in zip(down, planes.values(), strict=True)])


def test_the_edge_of_wall_and_floor_goes_on_behind_what_was_removed() -> None:
    depth = seen({n: PLANES[n] for n in (WALL, FLOOR)})
    truth = np.array([WALL, FLOOR], np.int32)[depth.argmin(axis=0)]
    points = cameras.rays(*SIZE, K) * depth.min(axis=0)[..., None]
    taken = np.zeros(SIZE, bool)
    taken[50:, 50:110] = True
    # A strip of the floor was too noisy for a plane.
    found = {**PLANES, 5: None}
    measured = np.where(taken, 0, truth).astype(np.int32)
    measured[100:, 110:] = 5
    whole = np.where(measured == 5, 5, truth)
    for guess in (WALL, FLOOR, 5):
        labels = np.where(taken, guess, whole).astype(np.int32)
        result = met(labels, taken, measured, points, found, K)
        np.testing.assert_array_equal(result[taken], truth[taken])
        np.testing.assert_array_equal(result[~taken], labels[~taken])


def test_the_front_of_a_cupboard_does_not_go_on_before_the_wall_above_it() -> None:
    planes = {WALL: PLANES[WALL], FRONT: (np.array([0.0, 0.0, -1.0]), 2.0)}
    labels = np.where(np.arange(SIZE[0])[:, None] < 60, WALL, FRONT) * np.ones(SIZE, np.int32)
    points = cameras.rays(*SIZE, K) * np.where(labels == WALL, 3.0, 2.0)[..., None]
    taken = np.zeros(SIZE, bool)
    taken[30:90, 60:100] = True
    measured = np.where(taken, 0, labels).astype(np.int32)
    result = met(labels.astype(np.int32), taken, measured, points, {SUPPORT: SUPPORT_PLANE, **planes}, K)
    np.testing.assert_array_equal(result, labels)
