"""What carries a thing: pixels at its foot are neither below the table nor beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from dextera_build.testing import RuleRunner
from rules.factorize.measured import Workspace
from rules.factorize.regions import heights, patches
from rules.factorize.regions.proposals import colour_lab
from tests import factories, tabletops


@pytest.mark.slow
def test_the_foot_of_a_thing_is_not_beyond_the_table(tmp_path: Path) -> None:
    # Large pictures are divided in blocks, and those at a foot show both thing and table.
    scene = tabletops.tabletop(
        (tabletops.box(0.1, 0.06, 0.14, (0.7, 0.1, 0.1)), factories.pose(yaw=0.5)),
        noise=1.0,
        lens=tabletops.FINE.scaled(2.0),
    )
    capture = scene.capture
    assert capture.measured is not None
    support = RuleRunner(tmp_path).run("align.support", **factories.shot(capture))
    seen = Workspace(capture.photograph, capture.measured.depth.depth, support)
    relief = heights.relief(seen)
    thing = scene.labels.labels == 1
    # The border is uncertain, and left out of what is raised.
    sure = ndimage.binary_erosion(thing & relief.raised)
    crop = patches.surfaces(relief, sure, seen, colour_lab(seen.pixels))
    rows, columns = np.nonzero(thing)
    top, left, stride = crop.top, crop.left, crop.stride
    assert stride == 2
    table = np.s_[
        (rows.min() - top) // stride : (rows.max() + 6 - top) // stride,
        (columns.min() - left) // stride : (columns.max() - left) // stride,
    ]
    assert (crop.beyond[table] > 0).mean() < 0.001
