"""simulate.view: the photograph's camera at another size."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import lie, transforms
from dextera_build.testing import RuleRunner
from tests import factories

CAMERA = Camera(width=1280, height=720, fx=912.4, fy=911.8, cx=643.2, cy=357.7)
POSE = factories.look_at((0.1, -0.9, 0.7))
SCENE = Scene(model=Folder(files={}), camera=CAMERA, camera_pose=factories.placed(POSE, "camera"), bodies=())


@pytest.fixture(scope="module")
def one_runner(tmp_path_factory: pytest.TempPathFactory) -> RuleRunner:
    """For all examples: to find the rules takes longer than to run this one."""
    return RuleRunner(tmp_path_factory.mktemp("view"))


@given(width=st.integers(8, 400), height=st.integers(8, 400))
def test_a_point_lands_where_cropping_and_scaling_the_photograph_puts_it(
    one_runner: RuleRunner, width: int, height: int
) -> None:
    made = one_runner.run("simulate.view", options={"width_px": width, "height_px": height}, scene=SCENE)
    small = made.camera
    scale = max(width / 1280, height / 720)
    point = np.array([0.13, -0.07, 1.2])
    full, seen = (camera.matrix() @ point / point[2] for camera in (CAMERA, small))
    # From the middle of the picture, in pixels: centres are integers, so the middle of 1280 columns is 639.5.
    expected = (full[:2] - [639.5, 359.5]) * scale
    np.testing.assert_allclose(seen[:2] - [(width - 1) / 2, (height - 1) / 2], expected, atol=1e-9)
    assert (small.width, small.height) == (width, height)
    np.testing.assert_array_equal(made.camera_pose.matrix, POSE)


def test_its_own_size_leaves_the_camera_as_it_is(tmp_path: Path) -> None:
    made = RuleRunner(tmp_path).run("simulate.view", options={"width_px": 1280, "height_px": 720}, scene=SCENE)
    np.testing.assert_allclose(made.camera.matrix(), CAMERA.matrix(), atol=1e-9)


def test_a_camera_put_by_hand_looks_at_its_target(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    eye, target = (0.5, -0.8, 0.9), (0.1, 0.2, 0.05)
    made = runner.run("simulate.view", options={"eye_m": eye, "target_m": target}, scene=SCENE)
    seen = np.linalg.inv(made.camera_pose.matrix) @ [*target, 1.0]
    np.testing.assert_allclose(seen[:2], 0.0, atol=1e-12)
    assert seen[2] == pytest.approx(np.linalg.norm(np.subtract(eye, target)))
    assert made.camera_pose.matrix[2, 0] == pytest.approx(0.0)
    assert runner.outcome.line == "128 x 96 px, placed by hand"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"eye_m": (0.0, 0.0, 1.0)}, "`eye_m` and `target_m` go together"),
        ({"eye_m": (0.0, 0.0, 1.0), "target_m": (0.0, 0.0, 0.0)}, "straight up or down"),
    ],
)
def test_what_cannot_be_looked_through_is_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(RuleError, match=message):
        RuleRunner(tmp_path).run("simulate.view", options=options, scene=SCENE)


def test_a_shift_moves_the_camera_and_does_not_turn_it(tmp_path: Path) -> None:
    runner = RuleRunner(tmp_path)
    still = runner.run("simulate.view", scene=SCENE)
    moved = runner.run("simulate.view", options={"shift_m": (0.02, 0.0, -0.01)}, scene=SCENE)
    assert np.allclose(moved.camera_pose.matrix[:3, 3] - still.camera_pose.matrix[:3, 3], [0.02, 0.0, -0.01])
    assert np.array_equal(moved.camera_pose.matrix[:3, :3], still.camera_pose.matrix[:3, :3])


@pytest.mark.parametrize("angle_deg", [-90.0, 60.0, 180.0])
def test_a_camera_turned_about_what_it_looks_at_sees_it_in_the_same_place(
    one_runner: RuleRunner, angle_deg: float
) -> None:
    made = one_runner.run("simulate.view", options={"orbit_deg": angle_deg}, scene=SCENE)
    eye, axis = POSE[:3, 3], POSE[:3, 2]
    centre = np.append(eye - axis * eye[2] / axis[2], 1.0)
    before, after = (np.linalg.inv(pose) @ centre for pose in (POSE, made.camera_pose.matrix))
    np.testing.assert_allclose(after, before, atol=1e-12)
    assert made.camera_pose.matrix[2, 3] == pytest.approx(eye[2])
    arms = [pose[:2, 3] - centre[:2] for pose in (POSE, made.camera_pose.matrix)]
    (x, y), (there_x, there_y) = arms
    turned = np.degrees(np.arctan2(x * there_y - y * there_x, np.dot(*arms)))
    assert np.cos(np.radians(turned - angle_deg)) == pytest.approx(1.0)


def test_a_camera_that_does_not_look_down_cannot_be_turned_about_a_point(one_runner: RuleRunner) -> None:
    options = {"eye_m": (0.5, -0.8, 0.2), "target_m": (0.1, 0.2, 0.4), "orbit_deg": 60}
    with pytest.raises(RuleError, match="looks at no point of the support"):
        one_runner.run("simulate.view", options=options, scene=SCENE)


def test_an_error_of_the_calibration_is_one_of_the_camera(one_runner: RuleRunner) -> None:
    camera_from_base = transforms.invert(POSE) @ factories.pose(0.2, 0.4, 0.0, yaw=0.3)
    covariance = np.diag([1e-6, 4e-6, 9e-6, 1e-5, 1e-5, 1e-5])
    measured = Pose(parent="camera", child="base", matrix=camera_from_base, covariance=covariance)
    made = one_runner.run("simulate.view", scene=SCENE, measured=measured)
    np.testing.assert_allclose(made.camera_pose.matrix, POSE)
    assert made.camera_pose.covariance is not None
    # Samples of the calibration, each with the base where it is.
    random = np.random.default_rng(0)
    world_from_base = POSE @ camera_from_base
    places = []
    for error in random.multivariate_normal(np.zeros(6), covariance, 4000):
        drawn = transforms.rigid(
            lie.rotation(error[3:]) @ camera_from_base[:3, :3], camera_from_base[:3, 3] + error[:3]
        )
        places.append((world_from_base @ transforms.invert(drawn))[:3, 3])
    sampled = np.cov(np.array(places).T)
    np.testing.assert_allclose(made.camera_pose.covariance[:3, :3], sampled, rtol=0.15, atol=0.1 * sampled.max())
    assert one_runner.run("simulate.view", scene=SCENE).camera_pose.covariance is None


def test_only_the_photograph_s_camera_says_that_it_is_that_one(one_runner: RuleRunner) -> None:
    assert one_runner.run("simulate.view", scene=SCENE).photographed
    placed = {"eye_m": (0.5, -0.8, 0.9), "target_m": (0.1, 0.2, 0.05)}
    for options in (placed, {"shift_m": (0.02, 0.0, 0.0)}, {"orbit_deg": 60}):
        assert not one_runner.run("simulate.view", options=options, scene=SCENE).photographed
