"""Depth that is wider than its object is cut off where the photograph ends the object; nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from rules.factorize.masks import fattening
from rules.factorize.regions.heights import Relief

ROWS, COLUMNS = np.mgrid[:160, :220]
BOX = (abs(ROWS - 80) < 30) & (abs(COLUMNS - 110) < 40)
FAT = (abs(ROWS - 80) < 14) & (COLUMNS >= 150) & (COLUMNS < 186)
"""Right of the box, 36 px wide."""
RED, WOOD, OTHER_WOOD = (170, 40, 45), (170, 130, 90), (150, 108, 70)
NOBODY = np.zeros_like(BOX)


def relief(raised: np.ndarray) -> Relief:
    height = np.where(raised, 0.08, 0.0)
    points = np.stack([COLUMNS * 0.001, ROWS * 0.001, height], axis=-1)
    everywhere = np.ones_like(raised)
    return Relief(points, height, everywhere, np.full(height.shape, 0.005), raised, everywhere, ~everywhere)


def picture(*painted: tuple[np.ndarray, tuple[int, int, int]]) -> np.ndarray:
    colours = np.full((*BOX.shape, 3), WOOD, np.float64)
    for where, colour in painted:
        colours[where] = colour
    return np.clip(colours + np.random.default_rng(0).normal(0, 2, colours.shape), 0, 255).astype(np.uint8)


def thinned(mask: np.ndarray, pixels: np.ndarray, others: np.ndarray = NOBODY) -> np.ndarray:
    return fattening.thinned(mask, others, relief(mask | others), pixels)


def test_support_with_the_depth_of_an_object_is_cut_off() -> None:
    found = thinned(BOX | FAT, picture((BOX, RED)))
    assert (found & FAT).sum() < 0.1 * FAT.sum()
    assert (found & BOX).sum() > 0.98 * BOX.sum()


def test_it_is_cut_off_at_the_end_of_the_support_as_well() -> None:
    carpet = ROWS < 60  # the photograph has an edge along FAT that is no edge of the object
    found = thinned(BOX | FAT, picture((carpet, (40, 60, 90)), (BOX, RED)))
    assert (found & FAT).sum() < 0.1 * FAT.sum()


def test_what_it_had_joined_goes_with_it() -> None:
    island = (abs(ROWS - 80) < 5) & (COLUMNS >= 186) & (COLUMNS < 196)
    found = thinned(BOX | FAT | island, picture((BOX, RED), (island, (250, 250, 250))))
    assert not (found & island).any()


@pytest.mark.parametrize("colour", [RED, OTHER_WOOD], ids=["another colour", "the support's, with an outline"])
def test_a_handle_stays(colour: tuple[int, int, int]) -> None:
    mask = BOX | FAT
    assert (thinned(mask, picture((BOX, RED), (FAT, colour))) == mask).mean() > 0.999


def test_print_with_the_colour_of_the_support_stays() -> None:
    label = (abs(ROWS - 80) < 12) & (COLUMNS >= 135) & BOX  # reaches the border of the box over a third of its outline
    assert (thinned(BOX, picture((BOX, RED), (label, WOOD))) & label).sum() == label.sum()


def test_an_object_with_the_colours_of_its_support_stays_whole() -> None:
    assert (thinned(BOX | FAT, picture()) == (BOX | FAT)).all()


def test_an_object_beside_it_is_not_the_support() -> None:
    assert (thinned(BOX, picture((BOX, RED)), FAT) == BOX).all()
