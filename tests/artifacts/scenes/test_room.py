"""A room keeps its parts in one frame, and exports them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.image import DepthImage
from dextera_build.artifacts.scenes.room import Room
from dextera_build.artifacts.shapes.splats import Splats
from dextera_build.artifacts.spatial.point_cloud import PointCloud
from dextera_build.errors import ArtifactError
from tests import factories

SPLATS = Splats.of(factories.gaussians(20), "world")
POINTS = PointCloud(points=np.ones((3, 3), np.float32), frame="world")


def test_points_in_another_frame_are_refused() -> None:
    with pytest.raises(ArtifactError, match=r"the points are in frame `camera`, the Gaussians in `world`") as caught:
        Room(splats=SPLATS, points=POINTS.model_copy(update={"frame": "camera"}))
    assert caught.value.code == "DXB-A208"


def test_it_is_shown_and_exported(tmp_path: Path) -> None:
    room = Room(splats=SPLATS, points=POINTS, depth={"a.png": DepthImage(depth=np.ones((4, 5), np.float32))})
    assert list(room.facts()) == ["20 Gaussians", "3 points", "depth of 1 views", "frame world", "rgb"]
    assert room.picture().startswith(b"\x89PNG")
    room.export(tmp_path, "room")
    again = Splats.load(tmp_path / "room.splats.ply")
    assert again.frame == "world"
    assert np.allclose(again.means, SPLATS.means)
    assert PointCloud.load(tmp_path / "room.points.ply").frame == "world"
