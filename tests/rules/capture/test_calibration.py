"""capture.calibration: calibrations of ROS packages are inputs."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.testing import RuleRunner
from tests.artifacts.test_calibration import CAMERA, SECOND, full


def test_it_reads_what_a_calibration_writes(tmp_path):
    full(camera=CAMERA).save(tmp_path / "arm.yaml")
    found = RuleRunner(tmp_path).run("capture.calibration", file=File.of(tmp_path / "arm.yaml"))
    assert found.camera == CAMERA
    assert list(found.facts()) == list(full().facts())


def test_intrinsics_may_be_a_file_of_their_own(tmp_path):
    CAMERA.save(tmp_path / "info.yaml")
    info = File.of(tmp_path / "info.yaml")
    found = RuleRunner(tmp_path).run("capture.calibration", file=File(data=SECOND.encode()), camera_info=info)
    assert found.camera == CAMERA
