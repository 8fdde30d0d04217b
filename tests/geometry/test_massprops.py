"""Mass properties against closed forms, manifold3d, and their own scaling laws."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import lie, massprops, solids
from tests import object_views


def test_a_box_has_its_closed_form_wherever_it_stands():
    x, y, z = 0.1, 0.2, 0.3
    box = solids.box((x, y, z), (10.0, -20.0, 30.0))
    found = massprops.of_mesh(box.vertices, box.faces)
    assert found.volume == pytest.approx(x * y * z, rel=1e-12)
    assert found.centre == pytest.approx([10.0, -20.0, 30.0], abs=1e-12)
    expected = found.volume / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
    assert found.inertia == pytest.approx(np.diag(expected), rel=1e-9, abs=1e-15)


def test_a_fine_sphere_approaches_two_fifths_m_r_squared():
    rings = [(0.05 * np.sin(a), -0.05 * np.cos(a)) for a in np.linspace(0.02, np.pi - 0.02, 60)]
    ball = object_views.turned(rings, 128)
    found = massprops.of_mesh(ball.vertices, ball.faces)
    assert found.volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=5e-3)
    assert massprops.principal(found.inertia) == pytest.approx([0.4 * found.volume * 0.05**2] * 3, rel=5e-3)


def test_a_turned_body_keeps_its_principal_moments():
    body = object_views.bracket()
    before = massprops.of_mesh(body.vertices, body.faces)
    turn = lie.rotation(np.array([0.3, -1.2, 0.7]))
    after = massprops.of_mesh(body.vertices @ turn.T, body.faces)
    assert after.inertia == pytest.approx(turn @ before.inertia @ turn.T, rel=1e-9, abs=1e-15)
    assert massprops.principal(after.inertia) == pytest.approx(massprops.principal(before.inertia), rel=1e-9)


@pytest.mark.parametrize("name", ["bowl", "mug", "bracket"])
def test_volume_agrees_with_manifold3d(name):
    import manifold3d

    body = getattr(object_views, name)()
    peer = manifold3d.Manifold(manifold3d.Mesh64(body.vertices, body.faces.astype(np.uint64)))
    assert massprops.of_mesh(body.vertices, body.faces).volume == pytest.approx(peer.volume(), rel=1e-9)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_scaling_laws_hold_for_the_integrals_themselves(scale):
    body = object_views.mug()
    predicted = massprops.of_mesh(body.vertices, body.faces).scaled(scale)
    direct = massprops.of_mesh(body.vertices * scale, body.faces)
    assert direct.volume == pytest.approx(predicted.volume, rel=1e-9)
    assert direct.inertia == pytest.approx(predicted.inertia, rel=1e-9, abs=1e-18)


def test_an_inside_out_mesh_is_refused():
    box = solids.box((1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match=r"the volume is -1 m3, a closed mesh with outward faces has a positive one"):
        massprops.of_mesh(box.vertices, box.faces[:, ::-1])


def test_the_triangle_inequality_decides_what_is_physical():
    assert massprops.is_physical(np.diag([1.0, 2.0, 3.0]))
    assert not massprops.is_physical(np.diag([1.0, 1.0, 2.1]))
    assert not massprops.is_physical(np.diag([0.0, 1.0, 1.0]))


def test_six_numbers_and_the_matrix_are_inverse():
    values = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    assert massprops.six(massprops.matrix(values)) == values
