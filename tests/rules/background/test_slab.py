"""The invented part of the support begins with the colour at the border of the visible one."""

from __future__ import annotations

import numpy as np

from rules.background.pieces import Piece, one_picture
from rules.background.slab import _continued


def test_a_picture_that_darkens_at_its_border_goes_on_as_dark_as_it_ends() -> None:
    size, first, last = 240, 60, 180
    shown = np.zeros((size, size), bool)
    shown[first:last, first:last] = True
    rows, columns = np.indices(shown.shape)
    inner = np.minimum.reduce([rows - first, columns - first, last - 1 - rows, last - 1 - columns])
    grain = 6.0 * np.sin((rows + columns) * 2 * np.pi / 9)
    colour = (200.0 - 14.0 * np.exp(-np.clip(inner, 0, None) / 5.0) + grain)[..., None] * [1.0, 0.9, 0.85]
    found = _continued(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown)
    middle = np.s_[first + 30 : last - 30]
    for outer, border in (
        (found[first - 4 : first, middle], colour[first : first + 4, middle]),
        (found[last : last + 4, middle], colour[last - 4 : last, middle]),
        (found[middle, first - 9 : first], colour[middle, first : first + 4]),
        (found[middle, last : last + 9], colour[middle, last - 4 : last]),
    ):
        assert abs(outer.mean() - border.mean()) < 2.5


def test_the_border_of_a_texture_does_not_mix_in_the_opposite_one() -> None:
    pixel = np.array([[-2.5, -0.5], [-2.5, 19.5], [41.5, 19.5]])
    corners = np.array([[0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    mesh = one_picture(
        [Piece(corners, np.array([[0, 1, 2]]), pixel, np.zeros((20, 40, 3), np.uint8))], np.zeros((20, 40, 3), np.uint8)
    )
    assert mesh.uv is not None
    # In a picture at a quarter of its size, too.
    texel = np.array([4.0 / 48, 4.0 / 28])
    assert (mesh.uv >= texel - 1e-6).all()
    assert (mesh.uv <= 1 - texel + 1e-6).all()
