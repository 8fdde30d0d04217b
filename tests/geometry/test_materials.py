"""The material table: complete, plausible, and near to things that were weighed."""

from __future__ import annotations

import math

import pytest

from dextera_build.geometry.materials import TABLE


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
