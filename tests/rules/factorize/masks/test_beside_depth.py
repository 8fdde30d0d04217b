"""A thing to the right of a depth image that is narrower than the photograph."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.testing import RuleRunner
from tests import factories, tabletops

INSIDE = (tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2)), factories.pose(-0.12, 0.0, yaw=0.4))
BESIDE = (tabletops.box(0.08, 0.08, 0.12, (0.2, 0.3, 0.7)), factories.pose(0.32, 0.0))
LAST = 470
"""First column without depth."""


@pytest.mark.slow
def test_a_thing_beside_the_depth_image_is_told_with_its_place(tmp_path):
    runner = RuleRunner(tmp_path)
    told = []
    for things in ((INSIDE, BESIDE), (INSIDE,)):
        full = tabletops.tabletop(*things, lens=tabletops.FINE)
        depth = full.capture.measured.depth.depth.copy()
        depth[:, LAST:] = 0.0
        shot = factories.shot(factories.rgbd(full.capture.photograph.rgb.pixels, depth, tabletops.FINE))
        support = runner.run("align.support", **shot)
        elements = runner.run("factorize.parse", **shot, support=support)
        found = runner.run("factorize.segment", **shot, support=support, elements=elements)
        assert len(found.names) == 1
        told.append([text for text in runner.outcome.warnings if "beside the depth image" in text])
        if len(things) == 2:
            rows, columns = np.nonzero(full.labels.labels == 2)
            true = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    (warning,), none = told
    assert none == []
    place = [int(number) for number in warning.split("box [")[1].split("]")[0].split(",")]
    assert columns.min() > LAST
    assert np.abs(np.subtract(place, true)).max() <= 8
