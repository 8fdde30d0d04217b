"""The rim of the support where removed things hide its edge."""

from __future__ import annotations

import cv2
import numpy as np

from dextera_build.geometry import cameras, regions, transforms
from rules.background.furnished import trimmed
from rules.background.layers import split
from rules.background.patch import SUPPORT, Patch
from rules.background.scenery import Scenery
from tests import factories

LENS = factories.camera(320, 240)
FLOOR = 2


def test_a_rim_of_support_beyond_its_edge_goes_to_the_floor() -> None:
    table = factories.support(0.45)
    pose, depth = table.camera_pose.matrix, factories.capture(LENS, table).measured.depth.depth
    places = transforms.apply(pose, cameras.backproject(depth, LENS.matrix()))[..., :2]
    table = table.model_copy(update={"polygon": table.polygon * 0.6})
    on = regions.inside_convex(places, table.polygon)
    far = np.argwhere(on)[0]
    hole = np.zeros_like(on)
    hole[far[0] - 20 : far[0] + 20, 120:180] = True
    wider = on | ((cv2.dilate(on.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & hole)
    photograph = factories.rgbd(np.full((*on.shape, 3), 120, np.uint8), depth, LENS).photograph
    layers = split(photograph, np.where(on, depth, 1.4 * depth).astype(np.float32), table, hole, 0.015)
    up, height = pose[2, :3], float(pose[2, 3])
    patches = [Patch(SUPPORT, (up, height)), Patch(FLOOR, (up, height + 0.7))]
    labels = np.where(wider, SUPPORT, FLOOR).astype(np.int32)
    scenery, rim = trimmed(Scenery(photograph.rgb.pixels, labels, patches, LENS.matrix(), pose), layers, table)
    added = wider & ~on
    assert added.sum() > 40
    assert (scenery.labels[added] == FLOOR).mean() > 0.8
    np.testing.assert_array_equal(rim, scenery.labels != labels)
    assert not (rim & ~hole).any()
    assert not (rim & cv2.erode(on.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)).any()
