"""Strips and crumbs of the support are no bodies; the same shape in another colour, or higher, is one."""

from __future__ import annotations

import pytest

from dextera_build.testing import RuleRunner
from tests import factories, tabletops

TABLE, BLUE = (0.65, 0.5, 0.35), (0.15, 0.2, 0.7)
BOX = (tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2)), factories.pose(-0.12, 0.05, yaw=0.4))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("colour", "height", "bodies"),
    [
        pytest.param(TABLE, 0.018, 1, id="edge"),
        pytest.param(BLUE, 0.018, 2, id="blue", marks=pytest.mark.slow),
        pytest.param(TABLE, 0.04, 2, id="high", marks=pytest.mark.slow),
    ],
)
def test_a_strip_with_the_colours_of_the_table_is_a_part_of_it(tmp_path, colour, height, bodies):
    strip = tabletops.box(0.2, 0.012, height, colour)
    scene = tabletops.tabletop(BOX, (strip, factories.pose(0.12, -0.08)), lens=tabletops.FINE)
    runner, shot = RuleRunner(tmp_path), factories.shot(scene.capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    assert sum(element.interactive for element in elements.elements) == 2
    found = runner.run("factorize.segment", **shot, support=support, elements=elements)
    assert len(found.names) == bodies
    told = [text for text in runner.outcome.warnings if "has the colours of the support" in text]
    assert len(told) == 2 - bodies
