"""align.camera_base: the base in the picture, out of a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.errors import RuleError
from dextera_build.geometry import uncertainty
from dextera_build.testing import RuleRunner
from tests import factories


def calibration(mount: str = "eye_on_base") -> Calibration:
    holder = "iiwa_base" if mount == "eye_on_base" else "flange"
    pose = factories.placed(factories.pose(0.5, 0.2, 0.9, 1.0), "rgb_frame", holder)
    pose = pose.model_copy(update={"covariance": np.diag([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]) * 1e-6})
    return Calibration(
        mount=mount,
        pose=pose,
        base_frame="iiwa_base" if mount == "eye_on_base" else "base",
        effector_frame="effector" if mount == "eye_on_base" else "flange",
    )


def test_it_is_the_inverse_with_its_covariance_in_frames_that_other_rules_know(tmp_path: Path) -> None:
    given = calibration()
    runner = RuleRunner(tmp_path)
    found = runner.run("align.camera_base", calibration=given)
    assert (found.parent, found.child) == ("camera", "base")
    np.testing.assert_allclose(found.matrix @ given.pose.matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(found.covariance, uncertainty.invert(given.pose.matrix, given.pose.covariance))
    position = 1000 * np.sqrt(np.trace(found.covariance[:3, :3]))
    assert position > 2.5 > 2.46 > 1000 * given.pose.sigma()[0]  # turning the camera moves the base
    assert f", sigma {position:.1f} mm and 0.04 deg" in runner.outcome.line


def test_a_camera_on_the_hand_has_no_base_in_its_picture(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="is on the hand"):
        RuleRunner(tmp_path).run("align.camera_base", calibration=calibration("eye_in_hand"))
