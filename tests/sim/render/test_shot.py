"""Pictures that are averaged from finer ones."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import cameras
from dextera_build.sim.render import shot


def test_black_and_white_average_to_half_the_light() -> None:
    board = np.zeros((4, 4, 3), np.uint8)
    board[::2, ::2] = board[1::2, 1::2] = 255
    assert shot.average(board, 2).shape == (2, 2, 3)
    np.testing.assert_allclose(shot.average(board, 2), 0.5 ** (1 / 2.2))
    flat = np.full((4, 4, 3), 100, np.uint8)
    np.testing.assert_allclose(shot.average(flat, 2), 100 / 255)


def test_an_enlarged_camera_sees_the_same() -> None:
    camera = Camera(width=64, height=48, fx=60.0, fy=58.0, cx=30.0, cy=25.0)
    point = np.array([[0.1, -0.2, 1.3]])
    small = cameras.project(point, camera.matrix())
    large = cameras.project(point, camera.scaled(3).matrix())
    # Pixel i covers fine pixels 3 i .. 3 i + 2, whose middle is 3 i + 1.
    np.testing.assert_allclose(large, 3 * small + 1)
    assert camera.scaled(3).width == pytest.approx(192)
