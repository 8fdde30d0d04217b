"""Closed bodies: volumes that are known, orientation, booleans."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import solids, transforms


def closed(solid: solids.Solid) -> bool:
    return Mesh(vertices=solid.vertices.astype(np.float32), faces=solid.faces.astype(np.int32)).is_closed


def rings(radii_and_heights: list[tuple[float, float]], count: int = 180) -> np.ndarray:
    return np.stack([solids.ring(r, r, 2.0, z, count) for r, z in radii_and_heights])


def test_a_box_is_closed_and_has_its_volume():
    body = solids.box((1.0, 2.0, 3.0), (5.0, 0.0, -1.0))
    assert closed(body)
    assert body.volume == pytest.approx(6.0)
    assert body.vertices.mean(axis=0) == pytest.approx([5.0, 0.0, -1.0])


def test_a_loft_over_two_circles_is_a_cylinder():
    body = solids.loft(rings([(0.5, 0.0), (0.5, 2.0)]))
    assert closed(body)
    assert body.volume == pytest.approx(np.pi * 0.25 * 2.0, rel=1e-3)


def test_rings_up_and_down_again_make_a_vessel():
    body = solids.loft(rings([(0.5, 0.0), (0.5, 1.0), (0.45, 1.0), (0.45, 0.1)]))
    assert closed(body)
    assert body.volume == pytest.approx(np.pi * (0.25 - 0.45**2 * 0.9), rel=1e-3)


def test_rings_downwards_turn_the_body_inside_out():
    assert solids.loft(rings([(0.5, 1.0), (0.5, 0.0)])).volume < 0


@pytest.mark.parametrize(("exponent", "area"), [(2.0, np.pi), (1.0, 2.0), (60.0, 4.0)])
def test_a_ring_is_an_ellipse_a_rhombus_or_nearly_a_rectangle(exponent, area):
    ring = solids.ring(3.0, 2.0, exponent, 0.0, 4000)
    x, y = ring[:, 0], ring[:, 1]
    found = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2
    assert found == pytest.approx(6.0 * area, rel=0.02)


def test_moving_keeps_volume_and_orientation():
    pose = transforms.rigid(transforms.rotation_between(np.array([0, 0, 1.0]), np.array([1.0, 1, 0])), np.ones(3))
    assert solids.box((1, 2, 3)).moved(pose).volume == pytest.approx(6.0)


def test_joined_parts_stay_apart_and_united_parts_do_not():
    parts = [solids.box((1, 1, 1)), solids.box((1, 1, 1), (0.5, 0, 0))]
    assert closed(solids.join(parts))
    assert solids.join(parts).volume == pytest.approx(2.0)
    assert closed(solids.union(parts))
    assert solids.union(parts).volume == pytest.approx(1.5)


def test_difference_and_largest():
    cut = solids.difference(solids.box((3, 1, 1)), solids.box((1, 2, 2), (0.5, 0, 0)))
    assert cut.volume == pytest.approx(2.0)
    assert solids.largest(cut).volume == pytest.approx(1.5)


def test_a_prism_with_a_hole():
    outer = np.array([[0, 0], [2, 0], [2, 2], [0, 2.0]])
    body = solids.extrude_rings([outer, outer * 0.5 + 0.5], 1.0, 2.5)
    assert closed(body)
    assert body.volume == pytest.approx(3.0 * 1.5)
    assert body.vertices[:, 2].min() == pytest.approx(1.0)
