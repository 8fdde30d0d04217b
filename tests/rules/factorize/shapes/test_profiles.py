"""Cross-sections of revolved bodies: round floors of cavities, rims around lids, plates."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.geometry import solids
from dextera_build.geometry.solids import Solid
from rules.factorize.contact import cavity
from rules.factorize.shapes import evidence, wall_pieces
from rules.factorize.shapes.families import lofted
from rules.factorize.shapes.families.profile import FACETS, LID_RIM_M, Profile
from rules.factorize.shapes.fitted import fitted_of
from rules.factorize.shapes.hypotheses import Finished, propose
from rules.factorize.shapes.refine import descend
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic

HEIGHTS = np.linspace(0.0, 0.06, 12)


def vessel(rising: float) -> Profile:
    """A straight cup of 60 mm with walls of 4 mm and a floor of 5 mm."""
    radius = np.full(12, 0.05)
    return Profile(HEIGHTS, radius, radius, wall=np.full(12, 0.004), floor=0.005, rising=rising)


def fitted(body: Solid, family: str, pitch_deg: float) -> tuple[evidence.Evidence, Finished, np.ndarray]:
    """The view, the body of a family that fits it best, and its parameters."""
    seen = synthetic.view(synthetic.placed(body, 0.01, 0.02, 20), synthetic.fine(distance=0.6, pitch_deg=pitch_deg))
    view = evidence.gather(object_views.seen(seen))
    (candidate,) = propose(view, (family,), 0.003)
    found = fitted_of(candidate, view, 14).parameters
    found = descend(candidate.model, view, found, 14).parameters
    return view, candidate.finish(found), found


def turned(profile: list[tuple[float, float]]) -> Solid:
    return solids.loft(np.stack([solids.ring(radius, radius, 2.0, height, 72) for radius, height in profile]))


def floor_at(body: Finished, radius: float) -> float:
    """Height of the cavity's floor at a distance from the axis [m]."""
    from dextera_build.geometry import raycast

    turn = np.arange(12) * np.pi / 6
    start = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.ones(12)])
    down = np.c_[start, np.tile([0.0, 0.0, -1.0], (12, 1))]
    return float(1.0 - np.median(raycast.cast([raycast.Surface(body.solid.vertices, body.solid.faces)], down).depth))


@pytest.mark.parametrize("rising", [0.0, 0.004, 0.023, 0.05, 1.0])
def test_a_cavity_rises_from_its_floor_to_the_wall_and_stays_inside(rising):
    rings = vessel(rising).inner(FACETS)
    radii, heights = np.linalg.norm(rings[:, 0, :2], axis=1), rings[:, 0, 2]
    assert (np.diff(heights) < 0).all()
    assert (np.diff(radii) < 1e-9).all(), "it narrows downwards"
    assert radii[0] == pytest.approx(0.046)
    assert heights[-1] == pytest.approx(0.005)
    assert (radii <= 0.046 + 1e-9).all()
    assert vessel(rising).solid(FACETS).volume > 0.0


def test_half_a_ball_fits_a_floor_that_rises_by_its_radius():
    """A floor that rises by the whole radius is a quarter of a circle in section."""
    tall = np.linspace(0.0, 0.12, 12)
    rings = Profile(tall, np.full(12, 0.05), np.full(12, 0.05), wall=np.full(12, 0.004), floor=0.005, rising=0.046)
    place = rings.inner(FACETS)[:, 0]
    low = place[place[:, 2] < 0.05]
    reach = np.hypot(np.linalg.norm(low[:, :2], axis=1), low[:, 2] - 0.051)
    assert reach == pytest.approx(np.full(len(low), 0.046), abs=0.0006)


@pytest.mark.parametrize("rising", [0.004, 0.03])
def test_the_pieces_of_a_round_cavity_leave_it_free(rising):
    profile = vessel(rising)
    pieces = [object_views.hull(Solid(corners, np.zeros((0, 3), int))) for corners in
              wall_pieces.ring_walls(profile.outer(FACETS), profile.inner(FACETS))]  # fmt: skip
    inside = cavity.find(object_views.mesh(profile.solid(FACETS)))
    filled = cavity.fill(inside, pieces)
    assert filled is not None
    assert filled < 0.04
    assert len(pieces) <= 121


@pytest.mark.medium
def test_a_round_bowl_has_a_round_cavity():
    turns = np.linspace(0.0, np.pi / 2, 14)
    inside = [(max(0.071 * np.sin(t), 5e-4), 0.005 + 0.046 * (1.0 - np.cos(t))) for t in turns[::-1]]
    body = turned([(0.05, 0.0), (0.08, 0.055), (0.076, 0.055), *inside])
    _, found, _ = fitted(body, "revolved_hollow", 45.0)
    assert found.hollow
    for radius, height in ((0.0, 0.005), (0.024, 0.0077), (0.04, 0.0130), (0.056, 0.0227)):
        assert floor_at(found, radius) == pytest.approx(height, abs=0.002)


@pytest.mark.medium
def test_a_can_is_as_high_as_its_rim():
    body = turned([(0.033, 0.0), (0.033, 0.1), (0.030, 0.1), (0.030, 0.095)])
    view, found, parameters = fitted(body, "cylinder", 45.0)
    assert lofted.lidded(view)
    assert found.solid.vertices[:, 2].max() == pytest.approx(0.1, abs=0.0015)
    assert parameters[4] == pytest.approx(0.005, abs=0.0015)
    assert np.ptp(found.solid.vertices[:, 0]) == pytest.approx(0.066, abs=0.002)


@pytest.mark.medium
def test_a_flat_top_has_no_rim():
    _, found, parameters = fitted(turned([(0.033, 0.0), (0.033, 0.1)]), "cylinder", 45.0)
    assert found.solid.vertices[:, 2].max() == pytest.approx(0.1, abs=0.0015)
    assert parameters[4] < 0.001


@pytest.mark.medium
def test_a_plate_widens_upwards():
    body = turned([(0.045, 0.0), (0.07, 0.018), (0.067, 0.018), (0.044, 0.004)])
    _, found, _ = fitted(body, "revolved_hollow", 45.0)
    sides = found.solid.vertices
    foot, rim = (np.linalg.norm(sides[near, :2], axis=1).max() for near in (sides[:, 2] < 1e-4, sides[:, 2] > 0.01))
    assert foot < 0.8 * rim
    assert rim == pytest.approx(0.07, abs=0.002)
    assert sides[:, 2].max() == pytest.approx(0.018, abs=0.003)


def test_a_narrow_top_has_no_rim():
    narrow = np.full(2, 1.5 * LID_RIM_M)
    assert not len(Profile(np.array([0.0, 0.1]), narrow, narrow, recess=0.004).inner(FACETS))
