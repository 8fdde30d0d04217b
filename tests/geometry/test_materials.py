"""The material table: complete, plausible, and near to things that were weighed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dextera_build.geometry.materials import TABLE, doubted


def test_the_materials_that_parsing_names_are_there():
    assert {"plastic", "ceramic", "cardboard", "metal", "glass", "wood", "electronics"} <= set(TABLE)


@pytest.mark.parametrize("name", sorted(TABLE))
def test_every_entry_is_plausible(name):
    material = TABLE[name]
    assert 50.0 < material.bulk_density <= material.wall_density < 9000.0
    assert 0.0 < material.wall_sigma < 1.0
    assert 0.0 < material.bulk_sigma < 1.0
    assert 0.1 < material.friction < 1.2
    assert 0.0 < material.restitution < 1.0
    assert material.friction_sigma > 0.0
    assert material.restitution_sigma > 0.0
    assert material.source


@pytest.mark.parametrize(
    ("name", "density"), [("electronics", 1060.0), ("electronics", 1580.0), ("paper", 800.0), ("wood", 700.0)]
)
def test_a_weighed_product_lies_inside_the_95_percent_interval(name, density):
    material = TABLE[name]
    assert abs(math.log(density / material.bulk_density)) < 1.96 * material.bulk_sigma


@pytest.mark.parametrize("name", sorted(TABLE))
def test_a_less_certain_material_has_wider_intervals(name):
    assert doubted(name, 1.0) == TABLE[name]
    widths = [doubted(name, confidence) for confidence in (1.0, 0.8, 0.3)]
    for field in ("wall_sigma", "bulk_sigma", "friction_sigma", "restitution_sigma"):
        values = [getattr(material, field) for material in widths]
        assert values == sorted(set(values)), field


def test_a_doubted_material_has_the_moments_of_the_mixture():
    """Drawn: ceramic with probability 0.6, otherwise one of the others."""
    random = np.random.default_rng(0)
    others = [material for name, material in TABLE.items() if name != "ceramic"]
    which = random.integers(len(others), size=200_000)
    is_own = random.uniform(size=len(which)) < 0.6
    own = TABLE["ceramic"]
    centre = np.where(is_own, own.friction, np.array([other.friction for other in others])[which])
    sigma = np.where(is_own, own.friction_sigma, np.array([other.friction_sigma for other in others])[which])
    drawn = centre + sigma * random.standard_normal(len(which))
    found = math.sqrt(float(np.mean((drawn - own.friction) ** 2)))
    assert doubted("ceramic", 0.6).friction_sigma == pytest.approx(found, rel=0.01)
