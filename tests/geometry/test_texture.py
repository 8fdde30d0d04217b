"""Atlases: every face has its own place on the picture, texels know where they are."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import solids, texture


@pytest.fixture(
    params=[
        solids.box((0.06, 0.16, 0.21)),
        solids.loft(
            np.stack([solids.ring(r, r, 2.0, z, 40) for r, z in ((0.03, 0), (0.04, 0.1), (0.036, 0.1), (0.03, 0.01))])
        ),
    ],
    ids=["box", "cup"],
)
def body(request: pytest.FixtureRequest) -> solids.Solid:
    solid: solids.Solid = request.param
    return solid


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def test_faces_do_not_share_texels(body):
    atlas = texture.unwrap(body.vertices, body.faces, 0.001, 1024)
    corners = atlas.uv * [atlas.width, atlas.height]
    a, b, c = np.moveaxis(corners, 1, 0)
    areas = np.abs(cross(b - a, c - a)) / 2
    covered = len(texture.texels(body.vertices, body.faces, atlas).row)
    assert covered == pytest.approx(areas.sum(), rel=0.05)


def test_it_is_never_mirrored(body):
    atlas = texture.unwrap(body.vertices, body.faces, 0.001, 1024)
    a, b, c = np.moveaxis(atlas.uv, 1, 0)
    assert (cross(b - a, c - a) > -1e-12).all()


def test_texels_lie_on_the_surface(body):
    atlas = texture.unwrap(body.vertices, body.faces, 0.002, 1024)
    texels = texture.texels(body.vertices, body.faces, atlas)
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    assert (texels.points >= low - 1e-6).all()
    assert (texels.points <= high + 1e-6).all()
    assert np.linalg.norm(texels.normals, axis=1) == pytest.approx(np.ones(len(texels.row)))
    # As many texels as the surface has area, seen from the six sides.
    assert np.ptp(texels.points, axis=0) == pytest.approx(high - low, abs=0.004)


def test_a_picture_that_would_be_too_large_becomes_coarser(body):
    atlas = texture.unwrap(body.vertices, body.faces, 0.0001, 256)
    assert max(atlas.width, atlas.height) <= 256
    assert atlas.uv.min() >= 0.0
    assert atlas.uv.max() <= 1.0


def test_bleeding_fills_with_the_nearest_colour():
    pixels = np.zeros((5, 5, 3))
    pixels[2, 0], pixels[2, 4] = (10, 0, 0), (0, 20, 0)
    filled = pixels.any(axis=-1)
    result = texture.bled(pixels, filled)
    assert result[0, 0] == pytest.approx([10, 0, 0])
    assert result[4, 4] == pytest.approx([0, 20, 0])


def test_normals_point_outwards():
    body = solids.box((1, 1, 1))
    normals = texture.face_normals(body.vertices, body.faces)
    middles = body.vertices[body.faces].mean(axis=1)
    assert ((normals * middles).sum(axis=1) > 0).all()
