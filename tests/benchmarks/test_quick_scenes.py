"""What the bonds learn from: things that stand where the truth says, the same for one seed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks import household, quick_scenes


@pytest.mark.medium
def test_things_stand_on_the_table_and_within_it() -> None:
    half = np.array([0.6, 0.4])
    for seed in range(8):
        things = quick_scenes.scene(np.random.default_rng(seed), half)
        assert things
        points = [np.concatenate([part.vertices for part in parts]) for parts in things]
        assert min(float(own[:, 2].min()) for own in points) == pytest.approx(0.0, abs=1e-6)
        for own in points:
            assert own[:, 2].min() > -1e-6
            assert (np.abs(own[:, :2]) < half + 0.15).all()


def test_a_vessel_holds_what_fits_into_it() -> None:
    for seed in range(20):
        vessel = household.bowl(np.random.default_rng(seed))
        assert vessel.inside is not None
        x, y, floor = vessel.inside
        points = vessel.parts[0].vertices
        assert 0.0 < floor < points[:, 2].max()
        assert max(x, y) < np.linalg.norm(points[:, :2], axis=1).max()


@pytest.mark.slow
def test_a_picture_shows_every_pixel_of_its_things_and_is_the_same_again() -> None:
    shots = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        room = quick_scenes.room(rng)
        shots.append(quick_scenes.photograph(quick_scenes.scene(rng, room.half), room, rng))
    one, other = shots
    assert (one.labels == other.labels).all()
    assert (one.rgb == other.rgb).all()
    assert len(np.unique(one.labels)) > 2
    # Only the things and the objects behind the table are above its plane.
    camera = one.support.camera_pose.matrix
    rows, columns = np.nonzero(one.labels)
    depth = one.depth[rows, columns]
    k = one.camera.matrix()
    seen = np.stack([(columns - k[0, 2]) / k[0, 0] * depth, (rows - k[1, 2]) / k[1, 1] * depth, depth], axis=1)
    heights = (seen @ camera[:3, :3].T + camera[:3, 3])[:, 2]
    assert heights.min() > -0.001
    assert heights.max() < 0.6
