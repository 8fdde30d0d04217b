"""What things are called by their outline and size."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from dextera_build.geometry import cameras, lie, solids, transforms
from dextera_build.geometry.solids import Solid
from rules.factorize.elements.nouns import noun
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


def lying(body: Solid, level: float) -> Solid:
    """The same on its side, its axis at a height [m]."""
    return body.moved(transforms.rigid(quarter(), np.array([0.0, 0.0, level])))


def quarter() -> np.ndarray:
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def oval(wide: float, deep: float, height: float) -> Solid:
    return solids.loft(np.stack([solids.ring(wide / 2, deep / 2, 4.0, z, 72) for z in (0.0, height)]))


def points_of(
    body: Solid, yaw_deg: float = 20.0, pitch_deg: float = 35.0, height: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seen points (N, 3), those not at the border, and the camera (3,), of a body at a height from a noisy view."""
    placed = body.moved(transforms.rigid(lie.about_z(np.deg2rad(yaw_deg)), np.array([0.02, 0.03, height])))
    eye = synthetic.fine(distance=0.8, pitch_deg=pitch_deg)
    seen = object_views.seen(synthetic.view(placed, eye))
    there = seen.mask & (seen.depth > 0)
    at = cameras.backproject(seen.depth.astype(float), seen.k)
    inner = there & ndimage.binary_erosion(seen.mask, iterations=2)
    points, own = (transforms.apply(seen.world_from_camera, at[shown]) for shown in (there, inner))
    return points, own, seen.world_from_camera[:3, 3]


def called(body: Solid, *, bent: bool = True, **view: float) -> str:
    """The word for a body."""
    return noun(*points_of(body, **view), bent=bent)


@pytest.mark.parametrize(
    ("radius", "height", "under"), [(0.033, 0.101, 0.0), (0.033, 0.101, 0.1), (0.033, 0.122, 0.07), (0.0375, 0.25, 0.0)]
)
def test_a_can_wherever_it_stands(radius, height, under):
    assert called(can(radius, height), height=under) == "can"


@pytest.mark.parametrize("yaw_deg", [-70.0, -10.0, 35.0])
@pytest.mark.parametrize("level", [0.033, 0.12])
def test_a_can_that_lies(yaw_deg, level):
    assert called(lying(can(0.033, 0.101), level), yaw_deg=yaw_deg, pitch_deg=50.0) == "can"


@pytest.mark.parametrize("hidden_m", [0.03, 0.045])
def test_a_can_of_which_a_nearer_thing_hides_the_lower_part(hidden_m):
    points, inner, eye = points_of(can(0.033, 0.101), pitch_deg=50.0)
    assert noun(points[points[:, 2] > hidden_m], inner[inner[:, 2] > hidden_m], eye, bent=True) == "can"


@pytest.mark.parametrize("yaw_deg", [-70.0, 35.0])
def test_a_bottle_that_lies_is_no_can(yaw_deg):
    assert called(lying(bottle(0.14), 0.034), yaw_deg=yaw_deg, pitch_deg=50.0) == ""


def test_an_oval_can():
    assert called(oval(0.097, 0.05, 0.082)) == "can"


def test_a_ball_and_a_disc_on_its_edge_are_no_cans():
    angles = np.linspace(-np.pi / 2 + 0.01, np.pi / 2 - 0.01, 24)
    assert called(turned([(0.035 * np.cos(a), 0.035 * (1 + np.sin(a))) for a in angles])) == ""
    assert called(lying(can(0.05, 0.03), 0.05), pitch_deg=50.0) == ""


def test_a_wide_flat_can_is_a_tin():
    assert called(can(0.092, 0.07)) == "tin"


@pytest.mark.parametrize("height", [0.19, 0.23])
def test_a_bottle_has_a_neck(height):
    assert called(bottle(height)) == "bottle"


@pytest.mark.parametrize("yaw_deg", [-30.0, 0.0, 30.0])
def test_a_drill_has_a_waist(yaw_deg):
    assert called(drill(), bent=False, yaw_deg=yaw_deg) == "drill"


def test_sizes_of_no_such_thing_give_no_word():
    assert called(drill(0.4), bent=False) == ""
    assert called(can(0.1, 0.35)) == ""
    assert called(bottle(0.5)) == ""


def test_a_cup_without_a_lid_is_no_can():
    assert called(object_views.cup(0.035, 0.12), pitch_deg=25.0) == ""


def test_a_straight_thing_with_flat_sides_is_no_can():
    assert called(solids.box((0.06, 0.06, 0.11), (0.0, 0.0, 0.055)), bent=False) == ""


def test_few_points_give_no_word():
    assert noun(np.zeros((20, 3)), np.zeros((20, 3)), np.array([0.0, -1.0, 1.0]), bent=True) == ""
