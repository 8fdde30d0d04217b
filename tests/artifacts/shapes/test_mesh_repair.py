"""Repair of meshes: textures stay in place, and the report says what was done."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.mesh_repair import repaired
from dextera_build.errors import MachineError
from tests import factories

MESH = factories.box_asset().body.links["base"].mesh


def damaged(*, missing: int = 2) -> Mesh:
    """Every face on its own, some turned, the first ones missing."""
    faces, uv = MESH.faces[missing:].copy(), MESH.uv
    assert uv is not None
    uv = uv[missing:].copy()
    faces[3:6], uv[3:6] = faces[3:6, ::-1], uv[3:6, ::-1]
    corners = np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    return MESH.model_copy(update={"vertices": MESH.vertices[faces].reshape(-1, 3), "faces": corners, "uv": uv})


def test_a_damaged_mesh_is_closed_again():
    made, report = repaired(damaged())
    assert made.is_closed
    assert (report.open_edges, report.is_solid, report.method) == (0, True, "manifold")
    assert report.open_edges_before > 0
    assert report.volume_m3 == pytest.approx(float(np.prod(MESH.extent)), rel=1e-5)
    assert {"faces turned", "holes filled", "faces added", "vertices welded"} == set(report.changes)
    assert str(report).endswith("closed, 0.001 m^3") or "; closed, " in str(report)


def test_the_texture_stays_where_it_was():
    made, _ = repaired(damaged())
    middle = MESH.vertices[MESH.faces].mean(axis=1)
    weight = np.full((1, 3), 1 / 3)
    known = 0
    for face, place in enumerate(made.vertices[made.faces].mean(axis=1)):
        old = int(np.argmin(np.linalg.norm(middle - place, axis=1)))
        if np.linalg.norm(middle[old] - place) < 1e-6 and old >= 2:
            assert np.allclose(made.paint(np.array([face]), weight), MESH.paint(np.array([old]), weight))
            known += 1
    assert known == len(MESH.faces) - 2


def test_a_sound_mesh_is_left_alone():
    made, report = repaired(MESH)
    assert np.array_equal(made.vertices, MESH.vertices)
    assert np.array_equal(made.faces, MESH.faces)
    assert report.changes == {}
    assert str(report).startswith("nothing changed; closed, ")


def test_what_stays_open_is_said():
    made, report = repaired(damaged(), longest_hole=0)
    assert not made.is_closed
    assert (report.is_solid, report.volume_m3) == (False, None)
    assert str(report).endswith(f"; {report.open_edges} open edges")


def test_meshlab_takes_apart_what_meets_in_one_edge():
    pytest.importorskip("pymeshlab")
    box = factories.box_mesh((0, 0, 0), (1, 1, 1))
    shared = factories.box_mesh((1, 1, 0), (2, 2, 1))
    vertices, index = np.unique(np.concatenate([box.vertices, shared.vertices]), axis=0, return_inverse=True)
    faces = index.reshape(-1)[np.concatenate([box.faces, shared.faces + 8])].astype(np.int32)
    both = Mesh(vertices=vertices, faces=faces)
    assert repaired(both)[1].open_edges > 0
    made, report = repaired(both, method="meshlab")
    assert made.is_closed
    assert report.volume_m3 == pytest.approx(2)


def test_meshlab_keeps_the_texture():
    pytest.importorskip("pymeshlab")
    made, report = repaired(damaged(), method="meshlab")
    assert (made.is_closed, report.method) == (True, "meshlab")
    assert made.texture is MESH.texture
    assert made.uv is not None


def test_without_meshlab_the_hint_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(MachineError, match="needs PyMeshLab, which is not installed") as caught:
        repaired(MESH, method="meshlab")
    assert caught.value.code == "DXB-E420"
    assert "[repair]" in (caught.value.hint or "")
