"""A small world with known truth: a table with a smooth pattern, before a wall that depth does not reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.geometry import cameras, transforms
from dextera_build.testing import RuleRunner
from rules.background.boxes import support_box
from rules.background.front import front
from rules.background.patch import SUPPORT, Patch
from rules.background.pieces import one_picture
from rules.background.scenery import Scenery
from rules.background.surface import plane_depth
from tests import factories

LENS = factories.camera(160, 120)
TABLE = factories.support(0.6)
EYE = TABLE.camera_pose.matrix[:3, 3]


def pattern(places: np.ndarray) -> np.ndarray:
    """Colours (..., 3) float64 of the plane z = 0 at world positions (..., 2) [m]."""
    x, y = places[..., 0], places[..., 1]
    waves = [np.sin(2 * np.pi * x / 0.5), np.cos(2 * np.pi * y / 0.6), np.sin(2 * np.pi * (x + y) / 0.8)]
    return 130 + 70 * np.stack(waves, axis=-1)


def background(lens: Camera = LENS, table: Support = TABLE) -> Background:
    """The table as the camera sees it; above the horizon a blue wall without depth."""
    depth = plane_depth(lens, table.camera_pose.matrix)
    known = np.isfinite(depth) & (depth < 3.0)
    depth = np.where(known, depth, 0.0)
    places = transforms.apply(table.camera_pose.matrix, cameras.backproject(depth, lens.matrix()))[..., :2]
    rows = np.indices(depth.shape)[0]
    wall = np.stack([40 + rows, 80 + rows // 2, np.full_like(rows, 200)], axis=-1)
    pixels = np.where(known[..., None], pattern(places), wall).clip(0, 255).round().astype(np.uint8)
    pose = table.camera_pose.matrix
    patch = Patch(SUPPORT, (pose[2, :3], float(pose[2, 3])))
    seen = Scenery(pixels, np.where(known, SUPPORT, 0).astype(np.int32), [patch], lens.matrix(), pose)
    mesh = one_picture(front(seen, 0.8, known, np.zeros(known.shape, np.int32)), pixels)
    box = support_box(table.polygon, 0.1, 0.05)
    return Background(
        image=Image(pixels=pixels), depth=DepthImage(depth=depth.astype(np.float32)), mesh=mesh, boxes=(box,)
    )


def runner(folder: Path) -> RuleRunner:
    """A runner in a folder that is made."""
    folder.mkdir(exist_ok=True)
    return RuleRunner(folder)
