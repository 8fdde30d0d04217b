"""Masks grow into what has no depth only where the colours are the object's."""

from __future__ import annotations

import numpy as np
import pytest

from rules.factorize.masks import matte
from rules.factorize.regions.heights import Relief

ROWS, COLUMNS = np.mgrid[:120, :160]
DISC = (ROWS - 60) ** 2 + (COLUMNS - 80) ** 2 <= 40**2
HOLE = (abs(ROWS - 60) < 12) & (COLUMNS > 75) & DISC
BLACK, WOOD = (25, 24, 26), (150, 110, 70)


def relief(measured: np.ndarray) -> Relief:
    """A disc of 80 mm, 30 mm above a support, with depth where `measured`."""
    height = np.where(DISC & ~HOLE, 0.03, 0.0)
    points = np.stack([COLUMNS * 0.001, ROWS * 0.001, height], axis=-1)
    threshold = np.full(DISC.shape, 0.005)
    return Relief(
        points, np.where(measured, height, 0.0), measured, threshold, measured & DISC & ~HOLE, measured, ~measured
    )


def picture(hole: tuple[int, int, int]) -> np.ndarray:
    colours = np.where((DISC & ~HOLE)[..., None], BLACK, WOOD)
    colours = np.where(HOLE[..., None], hole, colours)
    return np.clip(colours + np.random.default_rng(0).normal(0, 3, colours.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("measured", [~HOLE, np.ones_like(HOLE)], ids=["no depth", "as low as the support"])
@pytest.mark.parametrize(("colour", "grows"), [(BLACK, True), (WOOD, False)], ids=["its colour", "the support's"])
def test_a_bay_joins_the_mask_by_its_colour(measured: np.ndarray, colour: tuple[int, int, int], grows: bool) -> None:
    found = matte.bays(DISC & ~HOLE, np.zeros_like(DISC), relief(measured), picture(colour))
    assert found[DISC & ~HOLE].all()
    assert not (found & ~DISC).any()
    assert (found[HOLE].mean() > 0.8) if grows else (found[HOLE].mean() < 0.05)


def test_a_bay_of_another_object_stays_with_it() -> None:
    found = matte.bays(DISC & ~HOLE, HOLE, relief(~HOLE), picture(BLACK))
    assert (found == (DISC & ~HOLE)).all()
