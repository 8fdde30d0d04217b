"""Rotational symmetries: found for shapes that have them, with their orders, in any frame; and errors over them."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import lie, solids, symmetry
from rules.align.canonical.bodies import Surface
from tests import object_views

TURN = lie.rotation(np.array([0.9, -0.4, 1.7]))
SHAPES = {
    "cuboid": solids.box((0.12, 0.06, 0.08), (0.01, 0.02, 0.04)),
    "square bar": solids.box((0.06, 0.06, 0.15), (0.0, 0.0, 0.0)),
    "cube": solids.box((0.1, 0.1, 0.1), (0.0, 0.0, 0.0)),
    "bowl": object_views.bowl(),
    "mug": object_views.mug(),
    "bracket": object_views.bracket(),
}


def found(name: str) -> symmetry.Symmetry:
    solid = SHAPES[name]
    vertices = solid.vertices @ TURN.T * 3.0 + [0.5, 0.1, -0.2]
    body = object_views.body(object_views.mesh(solid))
    return symmetry.find(vertices, solid.faces, Surface(body, vertices, solid.faces).distances)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("cuboid", "order 2, order 2, order 2"),
        ("bowl", "round"),
        ("mug", "none"),
        ("bracket", "none"),
    ],
)
def test_axes_and_orders(name, said):
    assert str(found(name)) == said


def test_the_group_of_a_cuboid_has_four_and_that_of_a_square_bar_eight_elements():
    assert len(found("cuboid").turns()) == 4
    assert len(found("square bar").turns()) == 8


def test_a_cube_has_24_rotations():
    assert len(found("cube").turns()) == 24


def test_angles_respect_the_symmetry():
    cuboid, bowl, mug = found("cuboid"), found("bowl"), found("mug")
    half = TURN @ lie.rotation(np.array([0.0, 0.0, np.pi])) @ TURN.T
    assert np.degrees(cuboid.angle(np.eye(3), half)) == pytest.approx(0.0, abs=1.0)
    assert np.degrees(mug.angle(np.eye(3), half)) == pytest.approx(180.0, abs=0.1)
    spun = TURN @ lie.rotation(np.array([0.0, 0.0, 1.234])) @ TURN.T
    assert np.degrees(bowl.angle(np.eye(3), spun)) == pytest.approx(0.0, abs=1.0)
    tipped = TURN @ lie.rotation(np.array([0.3, 0.0, 0.0])) @ TURN.T
    assert bowl.angle(np.eye(3), tipped) == pytest.approx(0.3, abs=0.02)


def test_a_bowl_upside_down_is_another_pose():
    over = TURN @ lie.rotation(np.array([np.pi, 0.0, 0.0])) @ TURN.T
    assert np.degrees(found("bowl").angle(np.eye(3), over)) > 175.0
