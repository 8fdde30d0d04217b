"""Repair of triangles: a closed surface that was damaged is closed again, with its old corners."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import repair
from tests import factories

BOX = factories.box_mesh((0, 0, 0), (1, 1, 1))
BOWL = factories.bowl_asset().body.links["base"].mesh


def torn(faces: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same triangles, none of which shares a vertex."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def volume(mesh: repair.Triangles) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    return float((np.cross(a, b) * c).sum() / 6)


def test_a_closed_mesh_stays_as_it_is():
    made = repair.repaired(BOWL.vertices, BOWL.faces, 1e-9, 100)
    assert np.array_equal(made.vertices.astype(np.float32), BOWL.vertices)
    assert np.array_equal(made.faces, BOWL.faces)
    assert set(made.counts.values()) == {0}


def test_torn_triangles_are_welded():
    vertices, faces = torn(BOX.faces, BOX.vertices)
    noise = np.random.default_rng(0).uniform(-1e-7, 1e-7, vertices.shape)
    assert repair.open_edges(faces) == 36
    made = repair.repaired(vertices + noise, faces, 1e-6, 0)
    assert made.counts["vertices welded"] == 28
    assert repair.open_edges(made.faces) == 0
    assert repair.open_edges(repair.repaired(vertices + noise, faces, 0.0, 0).faces) == 36
    assert repair.open_edges(repair.repaired(vertices, faces, None, 0).faces) == 36


def test_faces_that_count_for_nothing_are_dropped():
    faces = np.concatenate([BOX.faces, BOX.faces[:2, [1, 2, 0]], BOX.faces[:1, ::-1], [[0, 0, 1]]])
    made = repair.repaired(BOX.vertices, faces, 0.0, 0)
    assert np.array_equal(made.faces, BOX.faces)
    assert made.counts["repeated faces dropped"] == 3
    assert made.counts["faces without area dropped"] == 1


@pytest.mark.parametrize("seed", range(5))
def test_faces_are_turned_one_way_round(seed):
    turned = np.random.default_rng(seed).permutation(len(BOWL.faces))[:25]
    faces = BOWL.faces.copy()
    faces[turned] = faces[turned, ::-1]
    made = repair.repaired(BOWL.vertices, faces, 0.0, 0)
    assert np.array_equal(made.faces, BOWL.faces)
    assert made.counts["faces turned"] == 25


def test_a_mesh_that_is_inside_out_is_turned():
    made = repair.repaired(BOX.vertices, BOX.faces[:, ::-1], 0.0, 0)
    assert volume(made) == pytest.approx(1)
    assert made.counts["faces turned"] == 12


def test_a_cavity_stays_one():
    """Two closed shells, one within the other and turned inwards."""
    vertices = np.concatenate([BOX.vertices, 0.25 + 0.5 * BOX.vertices])
    faces = np.concatenate([BOX.faces, BOX.faces[:, ::-1] + 8])
    made = repair.repaired(vertices, faces, 0.0, 0)
    assert volume(made) == pytest.approx(1 - 0.125)


@pytest.mark.parametrize("seed", range(8))
def test_holes_are_filled(seed):
    """Also where holes touch one another in a vertex."""
    kept = np.sort(np.random.default_rng(seed).permutation(len(BOWL.faces))[12:])
    made = repair.repaired(BOWL.vertices, BOWL.faces[kept], 0.0, 100)
    assert repair.open_edges(BOWL.faces[kept]) > 0
    assert repair.open_edges(made.faces) == 0
    assert volume(made) == pytest.approx(volume(repair.repaired(BOWL.vertices, BOWL.faces, 0.0, 0)), rel=0.2)
    old = made.source[:, 0] >= 0
    corners = BOWL.faces[kept].reshape(-1)[made.source[old]]
    assert np.array_equal(made.vertices[made.faces[old]], BOWL.vertices[corners].astype(np.float64))
    assert made.counts["faces added"] == int((~old).sum()) > 0


def test_a_flat_hole_is_filled_flat():
    side = np.flatnonzero(BOX.vertices[BOX.faces][:, :, 2].min(axis=1) == 1)
    made = repair.repaired(BOX.vertices, np.delete(BOX.faces, side, axis=0), 0.0, 4)
    assert (made.counts["holes filled"], made.counts["faces added"]) == (1, 2)
    assert volume(made) == pytest.approx(1)


def test_long_holes_are_left_or_become_a_fan(monkeypatch):
    open_top = BOWL.faces[BOWL.vertices[BOWL.faces][:, :, 2].max(axis=1) < 0.059]
    assert repair.open_edges(repair.repaired(BOWL.vertices, open_top, 0.0, 15).faces) == 32
    monkeypatch.setattr(repair, "_LONGEST_EXACT", 10)
    made = repair.repaired(BOWL.vertices, open_top, 0.0, 16)
    assert repair.open_edges(made.faces) == 0
    assert made.counts["faces added"] == 32


def test_nothing_is_repaired_to_nothing():
    made = repair.repaired(np.zeros((0, 3)), np.zeros((0, 3), np.int64), 1e-6, 10)
    assert (len(made.vertices), len(made.faces)) == (0, 0)


def test_edges_with_three_faces_stay_open():
    faces = np.concatenate([BOX.faces, [[0, 1, 7]]])
    assert repair.open_edges(repair.repaired(BOX.vertices, faces, 0.0, 100).faces) > 0
