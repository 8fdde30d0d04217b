"""Points of the pixels of a depth view, and pixels of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from dextera_build.geometry import cameras, transforms
from dextera_build.geometry.depth_view import DepthView


@dataclass(frozen=True)
class View(DepthView):
    """A depth image, its camera and the camera's pose."""

    depth: np.ndarray
    k: np.ndarray
    world_from_camera: np.ndarray


@pytest.fixture
def view() -> View:
    k = np.array([[50.0, 0.0, 19.0], [0.0, 51.0, 14.0], [0.0, 0.0, 1.0]])
    depth = np.random.default_rng(0).uniform(0.5, 1.5, (30, 40))
    return View(depth, k, cameras.look_at(np.array([0.3, -0.8, 0.6]), np.zeros(3)))


def test_a_pixel_is_found_at_its_own_point(view: View) -> None:
    rows, columns, inside, z = view.find(view.world_points())
    assert inside.all()
    assert np.array_equal([rows, columns], np.indices(view.depth.shape))
    assert np.allclose(z, view.depth)


def test_points_of_chosen_pixels_are_some_of_all_points(view: View) -> None:
    chosen = view.depth > 1.0
    assert np.allclose(view.world_points(chosen), view.world_points()[chosen])
    back = transforms.apply(transforms.invert(view.world_from_camera), view.world_points(chosen))
    assert np.allclose(back, view.camera_points(chosen))
    assert np.allclose(view.camera_points(chosen)[:, 2], view.depth[chosen])


def test_points_behind_the_camera_and_beside_the_picture_are_not_in_view(view: View) -> None:
    local = np.array([[0.0, 0.0, -1.0], [2.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    _, _, inside, z = view.find(transforms.apply(view.world_from_camera, local))
    assert inside.tolist() == [False, False, True]
    assert np.allclose(z, local[:, 2])
