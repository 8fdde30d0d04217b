"""capture.views, capture.rig and capture.panorama: what is exported can be an input again."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.testing import RuleRunner
from tests.artifacts.test_panorama import PIXELS
from tests.artifacts.test_rig import LEFT, RIGHT, load
from tests.artifacts.test_views import alike, encoded, views


def folder(root):
    return Folder(files={path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*.*")})


def test_views_are_read(tmp_path):
    views().export(tmp_path / "out", "scene")
    runner = RuleRunner(tmp_path)
    alike(views(), runner.run("capture.views", folder=folder(tmp_path / "out")))
    (tmp_path / "out" / "scene" / "transforms.json").unlink()
    found = runner.run("capture.views", options={"frame": "room"}, folder=folder(tmp_path / "out"))
    assert (found.frame, found.points.frame) == ("room", "room")


def test_pictures_are_checked(tmp_path):
    views().save(tmp_path / "out" / "transforms.json")
    encoded(np.zeros((2, 2, 3), np.uint8)).place(tmp_path / "out" / "images" / "left" / "1.png")
    with pytest.raises(ArtifactError, match="not of the size"):
        RuleRunner(tmp_path).run("capture.views", folder=folder(tmp_path / "out"))
    empty = Folder(files={"transforms.json": b'{"frames": []}'})
    with pytest.raises(RuleError, match="no picture has a pose"):
        RuleRunner(tmp_path).run("capture.views", folder=empty)


def test_a_rig_is_read(tmp_path):
    rig = load(tmp_path, {"cam0": LEFT, "cam1": RIGHT})
    found = RuleRunner(tmp_path).run("capture.rig", file=File.of(tmp_path / "camchain.yaml"))
    assert found.cameras == rig.cameras


def test_a_panorama_looks_along_x_with_z_up(tmp_path):
    runner = RuleRunner(tmp_path)
    found = runner.run("capture.panorama", file=encoded(PIXELS.pixels))
    assert (found.image.pixels == PIXELS.pixels).all()
    ahead, up = found.pose.matrix[:3, 2], -found.pose.matrix[:3, 1]
    assert ahead.tolist() == [1, 0, 0]
    assert up.tolist() == [0, 0, 1]
    with pytest.raises(RuleError, match="not twice as wide as high"):
        runner.run("capture.panorama", file=encoded(PIXELS.pixels[:3]))
