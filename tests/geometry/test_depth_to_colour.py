"""Depth seen from beside: planes come out where they are, the nearer of two wins, and nothing is invented."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import transforms
from dextera_build.geometry.depth_to_colour import registered

DEPTH = Camera(width=106, height=80, fx=80.0, fy=81.0, cx=52.5, cy=39.0)
COLOUR = Camera(width=160, height=120, fx=150.0, fy=149.0, cx=81.0, cy=58.5)
BESIDE = transforms.rigid(Rotation.from_rotvec([0.01, -0.02, 0.03]).as_matrix(), np.array([0.05, -0.01, 0.004]))
"""T_colour_depth."""


def plane(camera: Camera, normal: np.ndarray, distance: float) -> np.ndarray:
    """Depth of the plane normal . X = distance in a camera's frame."""
    column, row = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, np.ones(column.shape)], axis=-1)
    return (distance / (rays @ normal)).astype(np.float32)


def seen(depth: np.ndarray, motion: np.ndarray = BESIDE) -> np.ndarray:
    return registered(depth, DEPTH.matrix(), motion, COLOUR.project, (COLOUR.width, COLOUR.height))


def moved_plane(normal: np.ndarray, distance: float) -> np.ndarray:
    """The same plane as the colour camera sees it."""
    turned = BESIDE[:3, :3] @ normal
    return plane(COLOUR, turned, distance + float(turned @ BESIDE[:3, 3]))


@pytest.mark.parametrize(("normal", "distance"), [([0.0, 0.0, 1.0], 0.8), ([0.2, -0.3, 0.93], 1.1)])
def test_a_plane_is_where_it_is(normal, distance):
    unit = np.array(normal) / np.linalg.norm(normal)
    found, wanted = seen(plane(DEPTH, unit, distance)), moved_plane(unit, distance)
    inner = found[15:-15, 15:-15] > 0
    assert inner.mean() > 0.95
    error = np.abs(found - wanted)[15:-15, 15:-15][inner]
    # Half a pixel of the coarser camera on a tilted plane.
    assert np.median(error) < 0.003
    assert error.max() < 0.02


def test_the_nearer_wins_and_moves_by_its_parallax():
    far = plane(DEPTH, np.array([0.0, 0.0, 1.0]), 2.0)
    far[30:50, 40:66] = 0.5
    motion = transforms.rigid(np.eye(3), np.array([0.06, 0.0, 0.0]))
    found = seen(far, motion)
    near = np.argwhere((found > 0) & (found < 1.0))
    left, right = near[:, 1].min(), near[:, 1].max()
    wanted = [COLOUR.fx * ((u - DEPTH.cx) / DEPTH.fx + 0.06 / 0.5) + COLOUR.cx for u in (39.5, 65.5)]
    np.testing.assert_allclose([left, right], wanted, atol=1.0)
    row = found[COLOUR.height // 2]
    assert (row[left : right + 1] < 1.0).all()


def test_what_was_not_measured_is_not_invented():
    assert not seen(np.zeros((80, 106), np.float32)).any()
    one = np.zeros((80, 106), np.float32)
    one[40, 50] = 0.7
    found = seen(one)
    assert 1 <= (found > 0).sum() <= 9
    ahead = found[found > 0][0]
    assert ahead == pytest.approx(0.7 + 0.004, abs=0.02)
