"""evaluate.room: the twin's objects in the room of Gaussians."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.scenes.scene_fit import AlignedScene
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import RuleError
from dextera_build.gaussians import spherical_harmonics
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Context
from dextera_build.testing import RuleRunner
from rules.simulate.scene.scene import scene
from tests import factories

LENS, TABLE = factories.camera(), factories.support()


@pytest.fixture
def twin(tmp_path: Path) -> Scene:
    assets = {"box": factories.box_asset(factories.pose(-0.15))}
    return scene(
        Context(scratch=tmp_path), Collection[Asset](items=assets), factories.background(size=(240, 320)), TABLE, LENS
    )


def wall(depth: float, frame: str = "world") -> Room:
    """A blue wall across the view of the photograph's camera."""
    size = (LENS.height // 4, LENS.width // 4)
    rays = cameras.rays(LENS.height, LENS.width, LENS.matrix())[2::4, 2::4].reshape(-1, 3)
    places = transforms.apply(TABLE.camera_pose.matrix, depth * rays)
    count = size[0] * size[1]
    made = Gaussians(
        places,
        np.tile([1.0, 0, 0, 0], (count, 1)),
        np.full((count, 3), 3 * depth / LENS.fx),
        np.full(count, 0.98),
        spherical_harmonics.flat(np.tile([0.1, 0.2, 0.9], (count, 1))),
    )
    return Room(splats=Splats.of(made, frame), points=PointCloud(points=places.astype(np.float32), frame=frame))


def shown(
    folder: Path, twin: Scene, room: Room | AlignedScene, backend: str = "mujoco"
) -> tuple[np.ndarray, RuleRunner]:
    photograph = factories.capture(LENS, TABLE).photograph
    runner = RuleRunner(folder)
    made = runner.run("evaluate.room", backend=backend, photograph=photograph, scene=twin, room=room)
    return made.pixels[-LENS.height :, -LENS.width :].astype(int), runner


@pytest.mark.slow
def test_the_object_stands_before_a_far_wall_and_behind_a_near_one(tmp_path: Path, twin: Scene) -> None:
    blue = 255 * np.array([0.1, 0.2, 0.9])
    far, runner = shown(tmp_path, twin, wall(4.0))
    near, _ = shown(tmp_path, twin, wall(0.2))
    other = np.abs(far - blue).max(axis=-1) > 30
    assert 0.005 < other.mean() < 0.3
    # At the border of the picture the wall ends.
    assert (np.abs(near - blue).max(axis=-1) < 30)[8:-8, 8:-8].all()
    assert runner.outcome.line.startswith("1 object among")
    assert runner.outcome.metrics["likeness"][0] > 0


def test_the_stub_is_as_large(tmp_path: Path, twin: Scene) -> None:
    pixels, _ = shown(tmp_path, twin, wall(4.0), "stub")
    assert (pixels == 128).all()


def test_a_room_in_another_frame_is_refused(tmp_path: Path, twin: Scene) -> None:
    with pytest.raises(RuleError, match="not in the frame"):
        shown(tmp_path, twin, wall(4.0, "colmap"))


@pytest.mark.slow
def test_a_generated_room_is_shown_like_one_of_views(tmp_path: Path, twin: Scene) -> None:
    room = wall(4.0)
    composed, _ = shown(tmp_path, twin, room)
    generated, _ = shown(tmp_path, twin, AlignedScene(frame="world", splats=room.splats))
    assert (generated == composed).all()
    with pytest.raises(RuleError, match="the room has no Gaussians"):
        shown(tmp_path, twin, AlignedScene(frame="world"))
