"""reference.postures: where the joints really are in the pictures of `reference.robot_views`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.spatial.joints import Joints
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.rules.reference.posed import worlds

EXACT = {**worlds.SMALL, "count": 3, "errors": {"encoder_sigma_deg": 0.0, "zero_sigma_deg": 0.3}}


def postures(tmp_path: Path, **options: object) -> Joints:
    posture = {key: value for key, value in {**EXACT, **options}.items() if key != "supersample"}
    found = RuleRunner(tmp_path).run("reference.postures", world=worlds.world(), robot=worlds.robot(), options=posture)
    assert isinstance(found, Joints)
    return found


@pytest.mark.medium
def test_pictures_are_taken_where_the_postures_say_and_encoders_err_by_their_zeros(tmp_path: Path) -> None:
    true = postures(tmp_path)
    run = RuleRunner(tmp_path)
    own = run.run("reference.robot_views", world=worlds.world(), robot=worlds.robot(), options=EXACT)
    given = run.run("reference.robot_views", world=worlds.world(), robot=worlds.robot(), postures=true, options=EXACT)
    np.testing.assert_array_equal(given.joints.positions, own.joints.positions)
    for name, capture in given.captures.items():
        np.testing.assert_array_equal(capture.photograph.rgb.pixels, own.captures[name].photograph.rgb.pixels)
    off = given.joints.positions - true.positions
    np.testing.assert_allclose(off, np.broadcast_to(off[:1], off.shape), atol=1e-12)
    assert 0 < np.degrees(np.abs(off)).max() < 1.5


def test_postures_lie_around_the_joints_that_are_named(tmp_path: Path) -> None:
    raised = postures(tmp_path, joints_deg={"lean": 20.0}, reach_deg=8.0, tries=20000)
    lean = np.degrees(raised.positions[:, raised.names.index("lean")])
    assert (np.abs(lean - 20.0) <= 8.0).all()


def test_an_unknown_joint_and_too_few_tries_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match="no joint `elbow`"):
        postures(tmp_path, joints_deg={"elbow": 3.0})
    with pytest.raises(RuleError, match="only 0 postures"):
        postures(tmp_path, tries=1, widest_deg=1.0)
