"""Objects of boxes and cylinders, as data."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from rules.reference import solids
from rules.reference.assembly import Assembly
from rules.reference.objects import ThingOptions

BLOCKS = {
    "bar": {"size_m": (0.12, 0.03, 0.03), "at_m": (0.0, 0.03, 0.0)},
    "stem": {"size_m": (0.03, 0.09, 0.03), "at_m": (0.0, -0.03, 0.0)},
    "axle": {"shape": "cylinder", "size_m": (0.02, 0.02, 0.1), "at_m": (0.0, 0.05, 0.01), "turn_deg": (90.0, 0.0, 0.0)},
}


def made(**more: object) -> Assembly:
    return Assembly.model_validate({"kind": "assembly", "at_m": (0.1, 0.0), "blocks": BLOCKS, **more})


def test_blocks_stand_where_they_are_put_and_are_closed() -> None:
    parts = made().parts()
    assert list(parts) == list(BLOCKS)
    assert all(part.mesh.is_closed for part in parts.values())
    assert solids.volume(parts["bar"].mesh) == pytest.approx(0.12 * 0.03 * 0.03)
    assert solids.volume(parts["axle"].mesh) == pytest.approx(np.pi * 0.01**2 * 0.1, rel=2e-3)
    corners = parts["axle"].mesh.vertices
    # Turned about x, its axis runs towards -y from the middle of its base.
    assert corners[:, 1].min() == pytest.approx(-0.05, abs=1e-6)
    assert corners[:, 1].max() == pytest.approx(0.05, abs=1e-6)
    assert corners[:, 2].min() == pytest.approx(0.0, abs=1e-6)


def test_a_hinge_moves_its_blocks_about_a_unit_axis() -> None:
    moves = {
        "parts": ("stem",),
        "origin_m": (0.0, 0.01, 0.03),
        "axis": (0.0, 0.0, -2.0),
        "range_deg": (0.0, 90.0),
        "position_deg": 30.0,
        "mass_kg": 0.05,
    }
    hinge = made(moves=moves).hinge()
    assert hinge is not None
    assert hinge.axis == pytest.approx((0.0, 0.0, -1.0))
    assert hinge.upper == pytest.approx(np.pi / 2)
    assert hinge.position == pytest.approx(np.pi / 6)
    assert made().hinge() is None


def test_it_is_one_of_the_kinds_of_a_world() -> None:
    read = TypeAdapter(ThingOptions).validate_python({"kind": "assembly", "at_m": (0.0, 0.0), "blocks": BLOCKS})
    assert isinstance(read, Assembly)
