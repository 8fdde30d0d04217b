"""capture.lens: cameras from the files of calibration programs."""

from __future__ import annotations

import pytest

from dextera_build.artifacts.base import File
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.lens import Equirectangular, KannalaBrandt
from dextera_build.errors import ArtifactError
from dextera_build.testing import RuleRunner

FISHEYE = KannalaBrandt(width=640, height=480, fx=300.0, fy=301.0, cx=320.0, cy=240.0, k1=0.01)


@pytest.mark.parametrize(("form", "name"), [("ros", "camera.yaml"), ("colmap", "cameras.txt")])
def test_it_reads_what_a_lens_writes(tmp_path, form, name):
    FISHEYE.save(tmp_path / name)
    found = RuleRunner(tmp_path).run("capture.lens", options={"form": form}, file=File.of(tmp_path / name))
    assert found == FISHEYE


def test_it_returns_the_kind_of_the_file(tmp_path):
    runner = RuleRunner(tmp_path)
    for text, wanted in (
        ("1 PINHOLE 640 480 300 301 320.5 240.5", Camera(width=640, height=480, fx=300, fy=301, cx=320, cy=240)),
        ("1 EQUIRECTANGULAR 640 320 640 320", Equirectangular(width=640, height=320)),
    ):
        assert runner.run("capture.lens", options={"form": "colmap"}, file=File(data=text.encode())) == wanted


def test_another_file_is_refused(tmp_path):
    with pytest.raises(ArtifactError, match=r"`camera_info.yaml` cannot be read as ROS camera_info"):
        RuleRunner(tmp_path).run("capture.lens", file=File(data=b"\xff"))
