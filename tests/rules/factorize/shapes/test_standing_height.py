"""What carries an object: the surface seen below its mask, unless something nearer hides that."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.objects.view import Instance
from dextera_build.geometry import solids
from rules.factorize.shapes import evidence
from tests import object_views
from tests.rules.factorize import synthetic_views as synthetic

EYE = synthetic.Eye(distance=0.67, pitch_deg=40.0, focal=460.0, size=(480, 360))
SIDE_M = 0.05


def short(seen: Instance, rows: int) -> Instance:
    """The view with a mask that ends `rows` pixels above the object's lower border, as masks of mixed pixels do."""
    mask = seen.view.mask
    return object_views.changed(seen, mask=mask & np.roll(mask, -rows, axis=0))


def base(seen: Instance) -> float:
    return evidence.gather(object_views.seen(seen)).base


@pytest.mark.parametrize("rows", [0, 4, 6])
def test_what_a_wall_in_front_hides_does_not_stand_on_its_own_lower_part(rows: int) -> None:
    body = solids.box((SIDE_M, SIDE_M, SIDE_M), (0.0, 0.0, SIDE_M / 2))
    wall = solids.box((0.4, 0.01, 0.1), (0.0, -0.095, 0.05))
    seen = synthetic.view(body, EYE, hidden=(wall,))
    assert base(short(seen, rows)) == 0.0


@pytest.mark.parametrize("rows", [0, 2])
@pytest.mark.parametrize("deep", [0.05, 0.12])
def test_what_stands_on_a_box_stands_on_it_at_its_edge_as_well(rows: int, deep: float) -> None:
    carrier = solids.box((0.12, deep, 0.06), (0.0, 0.0, 0.03))
    body = solids.box((SIDE_M, SIDE_M, SIDE_M), (0.0, 0.0, 0.06 + SIDE_M / 2))
    seen = short(synthetic.view(body, EYE, hidden=(carrier,)), rows)
    assert base(object_views.changed(seen, occluder=np.zeros_like(seen.view.occluder))) == pytest.approx(0.06, abs=0.01)
