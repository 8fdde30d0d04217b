"""Overlaps, occluders, holes and borders of masks."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from dextera_build.code.loader import Library

Library().find("factorize.segment")
overlap = importlib.import_module("rules.factorize.overlap")
occlusion = importlib.import_module("rules.factorize.masks.occlusion")
matte = importlib.import_module("rules.factorize.masks.matte")
heights = importlib.import_module("rules.factorize.regions.heights")


def square(left: int, top: int, size: int, shape: tuple[int, int] = (60, 80)) -> np.ndarray:
    mask = np.zeros(shape, bool)
    mask[top : top + size, left : left + size] = True
    return mask


def test_box_overlap():
    assert overlap.box_iou((0, 0, 10, 10), (5, 0, 15, 10)) == pytest.approx(1 / 3)
    assert overlap.box_iou((0, 0, 10, 10), (10, 0, 15, 10)) == 0
    assert overlap.box_inside((2, 2, 4, 4), (0, 0, 10, 10)) == 1
    assert overlap.box_inside((0, 0, 10, 10), (2, 2, 4, 4)) == pytest.approx(0.04)


def test_duplicates_are_suppressed_by_iou_and_by_containment():
    masks = {
        "whole": square(10, 10, 20),
        "again": square(11, 10, 20),
        "part": square(12, 12, 5),
        "other": square(50, 10, 20),
        "overlapping": square(24, 10, 20),
        "nothing": np.zeros((60, 80), bool),
    }
    assert set(overlap.suppress(masks, 0.8, 0.95)) == {"whole", "other", "overlapping"}


def test_what_is_nearer_beside_an_object_may_hide_it():
    mask, other = square(10, 10, 20), square(30, 10, 20)
    depth = np.where(mask, 1.0, np.where(other, 0.8, 1.5))
    hidden = occlusion.occluders(mask, mask | other, depth)
    assert hidden[other].all()
    assert not (hidden & mask).any()
    behind = np.where(mask, 1.0, np.where(other, 1.2, 1.5))
    assert not occlusion.occluders(mask, mask | other, behind).any()


def flat_relief(raised: np.ndarray, valid: np.ndarray, points: np.ndarray) -> object:
    height = np.where(raised, 0.05, 0.0)
    threshold = np.full(raised.shape, 0.006)
    return heights.Relief(points, height, valid, threshold, raised & valid, valid, ~valid)


def ring() -> tuple[np.ndarray, np.ndarray]:
    """A ring of an object around a hole, and (60, 80, 3) points that look straight down at 1 mm a pixel."""
    rows, columns = np.indices((60, 80))
    distance = np.hypot(rows - 30, columns - 40)
    points = np.stack([columns * 0.001, -rows * 0.001, np.zeros((60, 80))], axis=-1)
    return (distance < 20) & (distance >= 8), points


def test_the_floor_of_a_bowl_is_filled():
    mask, points = ring()
    relief = flat_relief(mask, np.ones(mask.shape, bool), points)
    assert matte.fill(mask, np.zeros_like(mask), relief)[30, 40]


def test_what_shows_through_a_handle_is_not_filled():
    mask, points = ring()
    # The table behind the handle lies far outside of the object's footprint.
    points[~mask, 1] += 0.3
    relief = flat_relief(mask, np.ones(mask.shape, bool), points)
    assert not matte.fill(mask, np.zeros_like(mask), relief)[30, 40]


def test_another_object_in_the_hole_stays_out():
    mask, points = ring()
    other = square(37, 27, 6)
    relief = flat_relief(mask | other, np.ones(mask.shape, bool), points)
    assert not matte.fill(mask, other, relief)[30, 40]


def test_the_border_moves_to_the_colour_edge():
    truth, points = square(25, 15, 30), ring()[1]
    pixels = np.where(truth[..., None], (200, 40, 40), (120, 90, 60)).astype(np.uint8)
    pixels += np.random.default_rng(0).integers(0, 12, pixels.shape).astype(np.uint8)
    # Depth fattened the object by 4 px on the left and lost 5 px on the right.
    measured = np.roll(truth, -4, axis=1) | truth
    measured[:, 50:] = False
    valid = ~(truth & ~measured)
    relief = flat_relief(measured, valid, points)
    settled = matte.complete(measured, np.zeros_like(truth), relief, pixels)
    before, after = ((m & truth).sum() / (m | truth).sum() for m in (measured, settled))
    assert before < 0.8
    assert after > 0.95


def test_unevenness_of_the_support_is_taken_out():
    rows, columns = np.indices((120, 160))
    truth = 0.003 * ((columns / 160 - 0.5) ** 2 * 4 - 0.5) + 0.002 * (rows / 120 - 0.5)
    noise = np.random.default_rng(0).normal(0, 0.001, truth.shape)
    smooth = heights.warp(truth + noise, np.ones(truth.shape, bool))
    assert np.abs(smooth - truth).max() < 0.0008
