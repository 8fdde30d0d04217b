"""Where the support goes on behind removed pixels."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import cameras, regions, transforms
from rules.background.layers import split
from tests import factories

LENS = factories.camera(320, 240)


def test_the_support_goes_on_farther_than_measured_only_where_that_is_visible_beside_the_hole() -> None:
    table = factories.support(0.45)
    bare = factories.capture(LENS, table)
    depth = bare.measured.depth.depth
    places = transforms.apply(table.camera_pose.matrix, cameras.backproject(depth, LENS.matrix()))[..., :2]
    table = table.model_copy(update={"polygon": table.polygon * 0.5})
    on = regions.inside_convex(places, table.polygon)
    hole = np.zeros(depth.shape, bool)
    hole[60:150, 130:180] = True
    pixels = np.where(on[..., None], (170, 140, 110), (70, 70, 75)).astype(np.uint8)
    # Beside the table is a floor, of which depth was measured.
    floor = np.where(on, depth, 1.3 * depth).astype(np.float32)
    photograph = factories.rgbd(pixels, floor, LENS).photograph
    assert not split(photograph, floor, table, hole, 0.015).beyond.any()
    # Without depth and with the table's colours, it is more of the table.
    pixels = np.full_like(pixels, (170, 140, 110))
    near = np.where(on, depth, 0.0).astype(np.float32)
    photograph = factories.rgbd(pixels, near, LENS).photograph
    assert split(photograph, near, table, hole, 0.015).beyond.any()
