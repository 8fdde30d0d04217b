"""Several materials as one texture: every face keeps its colours."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import baking
from dextera_build.geometry.baking import Part, Surface

RNG = np.random.default_rng(2)
TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACE = np.array([[0, 1, 2]])


def shade(surface: Surface, face: int, weight: list[float]) -> np.ndarray:
    """Colour of a point of a face, 0..1, bilinear between the middles of texels as renderers sample."""
    assert surface.uv is not None
    assert surface.picture is not None
    rows, columns = surface.picture.shape[:2]
    u, v = np.array(weight) @ surface.uv[face]
    x, y = u * columns - 0.5, (1 - v) * rows - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    found = np.zeros(3)
    for row, below in ((top, 1 - (y - top)), (top + 1, y - top)):
        for column, right in ((left, 1 - (x - left)), (left + 1, x - left)):
            texel = surface.picture[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
            found += below * right * texel / 255
    return found


def test_one_colour_needs_no_texture():
    parts = [Part(TRIANGLE, FACE, (0.1, 0.2, 0.3)), Part(TRIANGLE + 1, FACE, (0.1, 0.2, 0.3))]
    whole = baking.joined(parts)
    assert (whole.colour, whole.uv, whole.picture) == ((0.1, 0.2, 0.3), None, None)
    assert whole.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert len(baking.joined([]).faces) == 0


def test_corners_of_one_colour_are_a_colour():
    whole = baking.joined([Part(TRIANGLE, FACE, corners=np.full((1, 3, 3), 0.25))])
    assert (whole.colour, whole.picture) == ((0.25, 0.25, 0.25), None)


def test_a_single_picture_stays_as_it_is():
    uv, picture = RNG.uniform(0, 1, (1, 3, 2)), RNG.integers(0, 256, (5, 7, 3), np.uint8)
    whole = baking.joined([Part(TRIANGLE, FACE, uv=uv, picture=picture)])
    assert whole.picture is picture
    assert whole.uv is uv


def test_colours_of_corners_blend_across_the_face():
    corners = RNG.uniform(0, 1, (7, 3, 3))
    faces = np.arange(21).reshape(7, 3)
    whole = baking.joined([Part(np.tile(TRIANGLE, (7, 1)), faces, corners=corners)])
    for face in range(7):
        for weight in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0.3, 0.5]):
            assert shade(whole, face, weight) == pytest.approx(np.array(weight) @ corners[face], abs=1 / 255)


def test_every_material_keeps_its_colours_in_the_atlas():
    first, second = (RNG.integers(0, 256, (size, 9, 3), np.uint8) for size in (6, 11))
    uv = np.array([[[0.1, 0.1], [0.9, 0.2], [0.3, 0.8]]])
    parts = [
        Part(TRIANGLE, FACE, uv=uv, picture=first),
        Part(TRIANGLE, FACE, uv=uv, picture=second),
        Part(TRIANGLE, FACE, (0.2, 0.4, 1.0)),
        Part(TRIANGLE, FACE, corners=np.array([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]])),
    ]
    whole = baking.joined(parts)
    for face, weight in ((0, [1, 0, 0]), (0, [0.3, 0.3, 0.4]), (1, [0, 1, 0]), (1, [0.2, 0.2, 0.6])):
        alone = baking.joined([parts[face]])
        assert shade(whole, face, weight) == pytest.approx(shade(alone, 0, weight), abs=1e-9)
    assert shade(whole, 2, [0.1, 0.4, 0.5]) == pytest.approx([0.2, 0.4, 1.0], abs=1 / 255)
    assert shade(whole, 3, [0.5, 0.25, 0.25]) == pytest.approx([0.5, 0.25, 0.25], abs=1.5 / 255)


def test_a_picture_that_repeats_is_laid_out():
    picture = RNG.integers(0, 256, (4, 4, 3), np.uint8)
    uv = np.array([[[-1.75, 3.25], [0.25, 3.25], [-1.75, 4.25]], [[7.25, 0.25], [7.5, 0.25], [7.25, 0.5]]])
    whole = baking.joined([Part(TRIANGLE, np.array([[0, 1, 2], [0, 1, 2]]), uv=uv, picture=picture)])
    assert whole.uv is not None
    assert whole.picture is not None
    assert whole.picture.shape == (8, 12, 3)
    assert (whole.uv >= 0).all()
    assert (whole.uv <= 1).all()
    for face in (0, 1):
        for corner in range(3):
            u, v = uv[face, corner] % 1
            wanted = picture[3 - int(v * 4), int(u * 4)]
            x, y = whole.uv[face, corner] * [12, 8]
            assert whole.picture[7 - int(y), int(x)].tolist() == wanted.tolist()


def test_what_does_not_fit_into_a_texture_is_refused(monkeypatch):
    picture = np.zeros((4, 4, 3), np.uint8)
    far = Part(TRIANGLE, FACE, uv=np.array([[[0.0, 0], [99, 0], [0, 1]]]), picture=picture)
    with pytest.raises(ValueError, match="its picture repeats 99 x 1 times across a face"):
        baking.joined([far])
    nowhere = Part(TRIANGLE, FACE, uv=np.array([[[0.0, 0], [np.nan, 0], [0, 1]]]), picture=picture)
    with pytest.raises(ValueError, match="its texture coordinates are not all finite"):
        baking.joined([nowhere])
    monkeypatch.setattr(baking, "LARGEST_PX", 10)
    many = Part(np.tile(TRIANGLE, (30, 1)), np.arange(90).reshape(30, 3), corners=RNG.uniform(0, 1, (30, 3, 3)))
    with pytest.raises(ValueError, match="its 30 faces have colours of their own"):
        baking.joined([many])
    near = Part(TRIANGLE, FACE, uv=np.zeros((1, 3, 2)), picture=picture)
    with pytest.raises(ValueError, match="its 3 pictures are together larger than 10 x 10 px"):
        baking.joined([near, near, near])
