"""The support's outline: a rectangle where the picture cuts it, what was seen elsewhere."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import raycast, regions
from rules.background.outline import outline
from rules.background.patch import SUPPORT, Patch
from rules.background.scenery import Scenery
from tests import factories

LENS = factories.camera(320, 240)
POSE = factories.look_at((0.0, -0.7, 0.6), (0.0, 0.0, 0.0))


def seen(*things: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Scenery:
    """Boxes in front of a wall, the first of which is the support with its top at z = 0."""
    meshes = [factories.box_mesh(low, high, (0.5, 0.5, 0.5)) for low, high in (*things, ((-4, 3, -2), (4, 3.1, 3)))]
    shapes = [raycast.Surface(mesh.vertices, mesh.faces) for mesh in meshes]
    shot = raycast.render(shapes, LENS.matrix(), POSE, LENS.height, LENS.width)
    labels = np.where(shot.index >= 0, shot.index + SUPPORT, 0).astype(np.int32)
    patches = [Patch(SUPPORT, (POSE[2, :3], float(POSE[2, 3])))]
    for number in range(2, len(meshes) + 1):
        inverse = np.where(shot.depth > 0, 1.0 / np.maximum(shot.depth, 1e-3), 0.1).astype(np.float32)
        patches.append(Patch(number, None, (0, 0), inverse))
    return Scenery(np.zeros((*labels.shape, 3), np.uint8), labels, patches, LENS.matrix(), POSE)


def made(scenery: Scenery) -> np.ndarray:
    corners = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    return outline(scenery, corners, np.zeros(scenery.labels.shape, bool))


def extent(edge: np.ndarray) -> np.ndarray:
    return np.stack([edge.min(axis=0), edge.max(axis=0)])


def test_a_table_that_is_seen_whole_is_as_it_is() -> None:
    found = extent(made(seen(((-0.3, -0.15, -0.03), (0.3, 0.25, 0.0)))))
    np.testing.assert_allclose(found, [[-0.3, -0.15], [0.3, 0.25]], atol=0.035)


def test_a_table_that_the_border_cuts_goes_on_as_a_rectangle() -> None:
    edge = made(seen(((-1.5, -1.5, -0.03), (1.5, 0.25, 0.0))))
    low, high = extent(edge)
    assert abs(high[1] - 0.25) < 0.03, "the far edge was seen"
    assert low[0] < -0.6
    assert high[0] > 0.6
    assert regions.area(edge) > 0.93 * np.prod(high - low), "corners are square, not those of the picture"


def test_what_stands_before_the_border_does_not_end_the_table() -> None:
    free = made(seen(((-1.5, -1.5, -0.03), (1.5, 0.25, 0.0))))
    mug = made(seen(((-1.5, -1.5, -0.03), (1.5, 0.25, 0.0)), ((-0.34, -0.36, 0.0), (-0.22, -0.26, 0.12))))
    np.testing.assert_allclose(extent(mug), extent(free), atol=0.08)
