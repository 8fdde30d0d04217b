"""align.support without depth: from a marker, from the robot, or assumed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import raycast, transforms
from dextera_build.testing import RuleRunner
from tests import factories

LENS = factories.camera(960, 720)
EYE = factories.look_at((0.1, -0.55, 0.5), (0.02, 0.0, 0.0))
"""T_world_camera over a table at z = 0, from which the camera looks down by 41.5 deg."""
SIZE_M = 0.08


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def photograph(*numbers: int) -> Photograph:
    """A table with markers of `SIZE_M` side by side, on white paper."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    things = [
        raycast.Surface(
            np.array([[-2.0, -2, -0.001], [2, -2, -0.001], [2, 2, -0.001], [-2, 2, -0.001]]),
            np.array([[0, 1, 2], [0, 2, 3]]),
            colour=(0.6, 0.5, 0.4),
        )
    ]
    for place, number in enumerate(numbers):
        ink = cv2.aruco.generateImageMarker(dictionary, number, 240)
        paper = np.pad(ink, 60, constant_values=255)
        half = SIZE_M / 2 * len(paper) / len(ink)
        x = 0.2 * place
        corners = np.array([[x - half, -half, 0], [x + half, -half, 0], [x + half, half, 0], [x - half, half, 0]])
        uv = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]], np.float32)
        texture = np.repeat(paper[..., None], 3, axis=-1)
        things.append(raycast.Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv, texture))
    seen = raycast.render(things, LENS.matrix(), EYE, LENS.height, LENS.width)
    return Photograph(rgb=Image(pixels=raycast.shade(things, seen)), camera=LENS)


def errors(found: Pose, true: np.ndarray) -> tuple[float, float]:
    """Tilt of the up direction [deg] and error of the height [m] of a T_world_camera."""
    cosine = float(found.matrix[2, :3] @ true[2, :3])
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))), float(abs(found.matrix[2, 3] - true[2, 3]))


def test_a_marker_gives_plane_and_scale(runner):
    found = runner.run("align.support", photograph=photograph(7), options={"marker": {"size_m": SIZE_M, "number": 7}})
    tilt, height = errors(found.camera_pose, EYE)
    assert tilt < 0.5
    assert height < 0.004
    sigma = np.sqrt(np.diag(found.camera_pose.covariance))
    assert height < 3 * sigma[2] < 0.02
    assert np.radians(tilt) < 3 * np.hypot(sigma[3], sigma[4]) < 0.05
    assert (found.scale, found.factor, found.residual_m) == ("marker", 1.0, None)
    assert runner.outcome.line == f"{found.camera_pose.matrix[2, 3]:.3f} m below the camera, by the marker"
    assert runner.outcome.metrics["marker residual"][1] == "px"


def test_the_robot_that_stands_on_the_support_gives_plane_and_scale(runner):
    base = factories.pose(0.2, 0.3, 0.05, yaw=1.0)
    mount = Pose(parent="camera", child="base", matrix=transforms.invert(EYE) @ base)
    given = {"photograph": photograph(), "robot": mount}
    found = runner.run("align.support", **given, options={"base_above_m": 0.05})
    tilt, height = errors(found.camera_pose, EYE)
    assert tilt < 1e-6
    assert height < 1e-9
    assert found.scale == "robot"
    with pytest.raises(RuleError, match="`robot` is T_world_base, but T_camera_base is needed"):
        runner.run("align.support", photograph=photograph(), robot=mount.model_copy(update={"parent": "world"}))


def test_otherwise_the_pitch_is_assumed_and_the_scale_unknown(runner):
    pitch = float(np.degrees(np.arcsin(-EYE[2, 2])))
    found = runner.run("align.support", photograph=photograph(), options={"pitch_deg": pitch})
    assert errors(found.camera_pose, EYE)[0] < 1e-6
    assert found.camera_pose.matrix[2, 3] == 1.0
    assert found.scale == "unknown"
    assert sigma_deg(found.camera_pose) == pytest.approx(4.0, rel=0.01)
    assert runner.outcome.line == f"stated: the camera looks down by {pitch:.3g} deg; scale unknown"
    assumed = runner.run("align.support", photograph=photograph())
    assert sigma_deg(assumed.camera_pose) == pytest.approx(10.0, rel=0.01)
    assert runner.outcome.line == "assumed: the camera looks down by 35 deg; scale unknown"


def sigma_deg(pose: Pose) -> float:
    """Standard deviation of the pitch."""
    assert pose.covariance is not None
    return float(np.degrees(np.sqrt(pose.covariance[3, 3])))


def test_gravity_tells_the_pitch_without_depth(runner):
    """A phone knows where down is: `capture.json` of a photograph alone may say so."""
    x, y, z = (float(each) for each in -EYE[2, :3])
    photo = photograph().model_copy(update={"gravity": (x, y, z)})
    found = runner.run("align.support", photograph=photo, options={"pitch_deg": 10.0})
    assert errors(found.camera_pose, EYE)[0] < 1e-6
    assert runner.outcome.line.startswith("gravity: the camera looks down by 42 deg")


def test_the_world_is_that_of_a_measured_support(runner):
    """Origin at the middle of the outline, x to the right in the photograph, z up."""
    found = runner.run("align.support", photograph=photograph())
    pose = found.camera_pose.matrix
    assert pose[0, 0] > 0.99
    assert pose[2, 0] == pytest.approx(0.0, abs=1e-9)
    low, high = found.polygon.min(axis=0), found.polygon.max(axis=0)
    assert (low < 0).all()
    assert (high > 0).all()
    assert np.linalg.norm(found.polygon + pose[:2, 3] * 0 - pose[:2, 3], axis=1).max() <= 3.0 + 1e-6


def test_depth_is_preferred_to_everything_else(runner):
    table = factories.capture()
    found = runner.run("align.support", **factories.shot(table), options={"marker": {"size_m": 1.0}})
    assert found.scale == "depth"


@pytest.mark.parametrize(("numbers", "count", "seen"), [((), 0, "none"), ((3,), 0, "3"), ((7, 7), 2, "7, 7")])
def test_a_marker_that_is_not_there_once_is_refused(runner, numbers, count, seen):
    with pytest.raises(RuleError) as caught:
        runner.run(
            "align.support", photograph=photograph(*numbers), options={"marker": {"size_m": SIZE_M, "number": 7}}
        )
    assert caught.value.message == f"marker 7 of DICT_4X4_50 is seen {count} times"
    assert caught.value.facts["seen"] == seen
    assert "flat on the support" in caught.value.hint


def test_a_dictionary_that_does_not_exist_lists_those_that_do(runner):
    options = {"marker": {"size_m": SIZE_M, "dictionary": "4X4"}}
    with pytest.raises(RuleError, match="no dictionary of markers is called `4X4`") as caught:
        runner.run("align.support", photograph=photograph(), options=options)
    assert "DICT_4X4_50" in caught.value.facts["exist"]


def test_a_camera_below_the_support_is_refused(runner):
    under = factories.pose(0.0, 0.0, 2.0)
    mount = Pose(parent="camera", child="base", matrix=transforms.invert(EYE) @ under)
    with pytest.raises(RuleError, match="the camera is below the support") as caught:
        runner.run("align.support", photograph=photograph(), robot=mount)
    assert caught.value.facts == {"scale": "robot"}
