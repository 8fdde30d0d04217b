"""Walls behind removed things: what is on them goes on at its height, and the floor stays on the floor."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import cameras, transforms
from rules.background.patch import SUPPORT, Patch
from rules.background.scenery import Scenery
from rules.background.walls import filled

SIZE = (240, 320)
K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
EYE = transforms.rigid(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([0.0, 0.0, 0.7]))
"""A camera that looks along y with z up, T_world_camera."""
WALL, FLOOR = (np.array([0.0, 0.0, -1.0]), 3.0), (np.array([0.0, -1.0, 0.0]), 0.7)
"""Planes in the camera frame: 3 m ahead, and 0.7 m below."""


def room(split: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W, 3) of a bright wall with a board at its foot, lit from the left, above a dark floor; and labels."""
    rays = cameras.rays(*SIZE, K)
    height = 0.7 - 3.0 * rays[..., 1]
    labels = np.where(height > 0.0, 2, 3).astype(np.int32)
    light = np.linspace(1.05, 0.85, SIZE[1])[None, :]
    wall = np.where((height > 0.0) & (height < 0.12), 110.0, 200.0) * light
    pixels = np.where(labels == 2, wall, 60.0)[..., None] * np.ones(3)
    if split:
        labels[(labels == 2) & (np.arange(SIZE[1]) > 150)] = 4
    return np.clip(pixels, 0, 255).astype(np.uint8), labels


def made(pixels: np.ndarray, labels: np.ndarray) -> Scenery:
    patches = [Patch(SUPPORT, (np.array([0.0, -1.0, 0.0]), 0.1)), Patch(2, WALL), Patch(3, FLOOR), Patch(4, WALL)]
    return Scenery(pixels, labels, patches, K, EYE)


def test_a_board_on_the_wall_goes_on_and_the_floor_does_not_run_into_it() -> None:
    for split in (False, True):
        whole, labels = room(split)
        hole = np.zeros(SIZE, bool)
        hole[60:215, 120:190] = True
        seen = whole.copy()
        seen[hole] = (255, 0, 0)
        found = filled(made(seen, labels), hole)
        inner = hole.copy()
        edges = np.abs(np.diff(whole.astype(int).sum(axis=-1), axis=0, prepend=0)) > 30
        inner &= ~(edges | np.roll(edges, -1, axis=0) | np.roll(edges, 1, axis=0) | np.roll(edges, -2, axis=0))
        assert np.abs(found.astype(int) - whole)[inner].max() < 8
        np.testing.assert_array_equal(found[~hole], seen[~hole])


def test_a_surface_of_which_nothing_is_in_view_keeps_its_colours() -> None:
    whole, labels = room()
    hole = labels == 3
    np.testing.assert_array_equal(filled(made(whole, labels), hole), whole)


def test_a_floor_behind_a_thing_has_the_colours_of_a_part_beside_it_that_was_too_noisy_for_a_plane() -> None:
    _, labels = room()
    pixels = np.where(labels == 2, 200.0, 60.0)[..., None] * np.ones(3)
    pixels[:, :60] *= 2.0
    pixels = pixels.astype(np.uint8)
    floor, columns = labels == 3, np.arange(SIZE[1])
    rays = cameras.rays(*SIZE, K)
    inverse = np.where(floor, rays[..., 1] / 0.7, 1.0 / 3.0).astype(np.float32)
    # The lit part of the floor at the left is a plane, the dark one beside the hole is not.
    labels[floor & (columns > 60)] = 5
    hole = np.zeros(SIZE, bool)
    hole[:, 200:280] = True
    labels[floor & hole] = 3
    seen = pixels.copy()
    seen[hole] = (255, 0, 0)
    scenery = made(seen, labels)
    scenery = Scenery(seen, labels, [*scenery.patches, Patch(5, None, (0, 0), inverse)], K, EYE)
    found = filled(scenery, hole)
    inner = floor & hole
    assert np.abs(found[inner].astype(int) - pixels[inner]).max() < 8
