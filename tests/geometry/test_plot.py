"""Pictures of lines: what is drawn is seen, and gaps stay empty."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry.plot import COLOURS, Line, plot


def columns(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Columns with a pixel of this colour."""
    return np.flatnonzero((picture == colour).all(axis=-1).any(axis=0))


def test_a_line_is_drawn_with_its_gap():
    x = np.linspace(0, 1, 101)
    y = np.where((x > 0.4) & (x < 0.6), np.nan, x)
    found = columns(plot([Line(np.stack([x, y], axis=1))], "x", "y"), COLOURS[0])
    share = np.diff(found).max() / (found.max() - found.min())
    assert 0.19 < share < 0.23


def test_equal_axes_keep_a_circle_round():
    angle = np.linspace(0, 2 * np.pi, 400)
    circle = Line(np.stack([5 + 3 * np.cos(angle), 3 * np.sin(angle)], axis=1), COLOURS[1], dots=True)
    picture = plot([circle], "x", "y", equal=True)
    rows, found = np.nonzero((picture == COLOURS[1]).all(axis=-1))
    assert abs(np.ptp(rows) - np.ptp(found)) <= 1


def test_nothing_and_one_point_are_drawn():
    assert plot([], "x", "y").shape == (240, 320, 3)
    assert len(columns(plot([Line(np.zeros((1, 2)), COLOURS[2], dots=True)], "x", "y"), COLOURS[2]))
