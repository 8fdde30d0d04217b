"""The outline of a mesh of unknown pose against a mask, on bodies whose outlines and visible areas are known."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import solids, transforms
from rules.factorize.shapes.outline import explain
from tests import object_views


def seen(solid, turn_deg=0.0):
    """Mask of the solid, turned about the vertical, before the camera of `object_views`."""
    turn = np.radians(turn_deg)
    c, s = np.cos(turn), np.sin(turn)
    pose = transforms.rigid(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.zeros(3))
    view = object_views.view(object_views.mesh(solid), pose).view
    return view.mask, view.occluder


@pytest.mark.parametrize(("turn_deg", "unit"), [(0.0, 1.0), (77.0, 35.0), (200.0, 1.0)])
def test_the_right_body_is_recognised_in_any_turn_and_unit(turn_deg, unit):
    mug = object_views.mug()
    found = explain(unit * mug.vertices + 3.0, mug.faces, *seen(mug, turn_deg))
    assert found.iou > 0.9


@pytest.mark.medium
def test_another_body_explains_less():
    bracket, mug = object_views.bracket(), object_views.mug()
    right = explain(bracket.vertices, bracket.faces, *seen(bracket, 20.0)).iou
    wrong = explain(mug.vertices, mug.faces, *seen(bracket, 20.0)).iou
    assert right > wrong + 0.2


@pytest.mark.slow
def test_occluded_pixels_do_not_count():
    bracket = object_views.bracket()
    mask, occluder = seen(bracket, 20.0)
    columns = np.flatnonzero(mask.any(axis=0))
    hidden = np.zeros_like(mask)
    middle = (columns[0] + columns[-1]) // 2
    hidden[:, middle : middle + 12] = True
    known = explain(bracket.vertices, bracket.faces, mask & ~hidden, hidden).iou
    unknown = explain(bracket.vertices, bracket.faces, mask & ~hidden, occluder).iou
    assert known > 0.88
    assert known > unknown


@pytest.mark.medium
def test_a_ball_shows_the_cap_that_geometry_says():
    ball = solids.loft(
        np.array([solids.ring(np.sin(a), np.sin(a), 2.0, -np.cos(a), 96) for a in np.linspace(0.02, 3.12, 60)])
    )
    mask, occluder = seen(solids.Solid(0.05 * ball.vertices + [0, 0, 0.05], ball.faces))
    found = explain(ball.vertices, ball.faces, mask, occluder)
    assert found.iou > 0.93
    # From 4 radii away a cap of height r (1 - 1/4) is seen: 3/8 of the area.
    assert found.unseen_fraction == pytest.approx(1.0 - 3.0 / 8.0, abs=0.02)


def test_the_inside_of_a_vessel_is_seen_from_above_only():
    cup = object_views.cup()
    found = explain(cup.vertices, cup.faces, *seen(cup))
    assert found.eye[2] > 0
    assert 0.5 < found.unseen_fraction < 0.85
