"""Holes of a flat texture are filled from its surroundings."""

from __future__ import annotations

import numpy as np
import pytest

from rules.background import synthesis


def striped(height: int, width: int) -> np.ndarray:
    rows = np.indices((height, width))[0]
    light = 120.0 + 40.0 * np.sin(rows * 2 * np.pi / 12)
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


def test_a_membrane_keeps_what_is_known_and_stays_between_it():
    rng = np.random.default_rng(0)
    for channels in (1, 3):
        values = rng.uniform(10.0, 90.0, (40, 33, channels)).astype(np.float32)
        known = rng.uniform(size=(40, 33)) < 0.2
        filled = synthesis.membrane(values, known)
        assert filled.shape == values.shape
        assert (filled[known] == values[known]).all()
        assert filled.min() > 9.9
        assert filled.max() < 90.1


def test_stripes_go_on_through_a_hole():
    image = striped(160, 200)
    hole = np.zeros(image.shape[:2], bool)
    hole[60:100, 80:130] = True
    damaged = np.where(hole[..., None], 0.0, image).astype(np.float32)
    filled = synthesis.fill_texture(damaged, hole, ~hole, np.ones(hole.shape, np.float32))
    assert (filled[~hole] == damaged[~hole]).all()
    assert np.corrcoef(filled[hole].ravel(), image[hole].ravel())[0, 1] > 0.95


def test_the_tile_with_most_known_pixels_is_filled_next(monkeypatch: pytest.MonkeyPatch):
    contexts: list[int] = []
    find = synthesis._Search.best

    def best(self, target, context, traits):
        contexts.append(int(np.count_nonzero(context)))
        return find(self, target, context, traits)

    monkeypatch.setattr(synthesis._Search, "best", best)
    image = striped(160, 200)
    hole = np.zeros(image.shape[:2], bool)
    hole[40:110, 70:150] = hole[20:60, 20:50] = True
    synthesis.fill_texture(image, hole, ~hole, np.ones(hole.shape, np.float32))

    # The order depends on the masks alone.
    tile = (
        2 * synthesis.SHRINK * max(3, round(float(np.sqrt(hole.sum() / synthesis.MOST_TILES)) / 2 / synthesis.SHRINK))
    )
    window, rim = 2 * tile, [(2 * tile, 2 * tile + -n % synthesis.SHRINK) for n in hole.shape]
    open_, known = np.pad(hole, rim), np.pad(~hole, rim)
    waiting, expected = synthesis._tiles(open_, tile), []
    while waiting:
        counts = [np.count_nonzero(known[synthesis._box(corner, tile // 2, window)]) for corner in waiting]
        expected.append(max(counts))
        area = synthesis._box(waiting.pop(int(np.argmax(counts))), tile // 2, window)
        known[area] |= open_[area]
    assert len(expected) > 5
    assert contexts == expected
