"""What things are called by their outline and size."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import cameras, lie, solids, transforms
from dextera_build.geometry.solids import Solid
from rules.factorize.elements.nouns import noun
from rules.factorize.shapes import evidence
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic


def turned(profile: list[tuple[float, float]]) -> Solid:
    return solids.loft(np.stack([solids.ring(radius, radius, 2.0, height, 72) for radius, height in profile]))


def can(radius: float, height: float) -> Solid:
    return turned([(radius, 0.0), (radius, height)])


def bottle(height: float) -> Solid:
    return turned([(0.034, 0.0), (0.034, 0.62 * height), (0.014, 0.8 * height), (0.014, height)])


def drill(scale: float = 1.0) -> Solid:
    parts = (
        solids.box((0.08, 0.07, 0.04), (0.0, 0.0, 0.02)),
        solids.box((0.036, 0.04, 0.13), (0.0, 0.0, 0.07)),
        solids.box((0.18, 0.046, 0.06), (0.04, 0.0, 0.155)),
    )
    made = solids.union(list(parts))
    return Solid(scale * made.vertices, made.faces)


def called(body: Solid, *, bent: bool, yaw_deg: float = 20.0, pitch_deg: float = 35.0, height: float = 0.0) -> str:
    """The word for a body that stands at some height, from one noisy view."""
    placed = body.moved(transforms.rigid(lie.about_z(np.deg2rad(yaw_deg)), np.array([0.02, 0.03, height])))
    eye = synthetic.fine(distance=0.8, pitch_deg=pitch_deg)
    seen = object_views.seen(synthetic.view(placed, eye))
    there = seen.mask & (seen.depth > 0)
    points = transforms.apply(seen.world_from_camera, cameras.backproject(seen.depth.astype(float), seen.k)[there])
    level = float((evidence.gather(seen).normals[:, 2] > 0.9).mean())
    return noun(points, seen.world_from_camera[:3, 3], level, bent=bent)


@pytest.mark.parametrize(
    ("radius", "height", "under"), [(0.033, 0.101, 0.0), (0.033, 0.101, 0.1), (0.033, 0.122, 0.07), (0.0375, 0.25, 0.0)]
)
def test_a_can_wherever_it_stands(radius, height, under):
    assert called(can(radius, height), bent=True, height=under) == "can"


def test_a_wide_flat_can_is_a_tin():
    assert called(can(0.092, 0.07), bent=True) == "tin"


@pytest.mark.parametrize("height", [0.19, 0.23])
def test_a_bottle_has_a_neck(height):
    assert called(bottle(height), bent=True) == "bottle"


@pytest.mark.parametrize("yaw_deg", [-30.0, 0.0, 30.0])
def test_a_drill_has_a_waist(yaw_deg):
    assert called(drill(), bent=False, yaw_deg=yaw_deg) == "drill"


def test_sizes_of_no_such_thing_give_no_word():
    assert called(drill(0.4), bent=False) == ""
    assert called(can(0.1, 0.35), bent=True) == ""
    assert called(bottle(0.5), bent=True) == ""


def test_a_cup_without_a_lid_is_no_can():
    assert called(object_views.cup(0.035, 0.12), bent=True, pitch_deg=25.0) == ""


def test_a_straight_thing_with_flat_sides_is_no_can():
    assert called(solids.box((0.06, 0.06, 0.11), (0.0, 0.0, 0.055)), bent=False) == ""


def test_few_points_give_no_word():
    assert noun(np.zeros((20, 3)), np.array([0.0, -1.0, 1.0]), 0.0, bent=True) == ""
