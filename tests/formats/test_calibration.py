"""Calibrations: files of easy_handeye in both versions, and what they say about themselves."""

from __future__ import annotations

import io

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from PIL import Image as Pillow
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import ArtifactError
from dextera_build.formats import calibration as calibration_files
from dextera_build.formats import lens as lens_files
from dextera_build.geometry.plot import COLOURS
from tests.artifacts.core.test_forms import same
from tests.artifacts.generated import values

FIRST = """parameters:
  eye_on_hand: true
  freehand_robot_movement: false
  move_group: manipulator
  namespace: /arm_eye_on_hand/
  robot_base_frame: iiwa_link_0
  robot_effector_frame: iiwa_link_ee
  tracking_base_frame: camera_optical
  tracking_marker_frame: marker
transformation: {qw: 0.49991, qx: -0.50621, qy: -0.49197, qz: -0.50190, x: 0.00117, y: 0.11323, z: 0.02148}
"""
SECOND = """parameters:
  calibration_type: eye_on_base
  robot_base_frame: fr3_link0
  robot_effector_frame: fr3_link8
  tracking_base_frame: camera_color_optical_frame
transform:
  translation: {x: 1.2, y: -0.1, z: 0.6}
  rotation: {x: 0.0, y: 0.0, z: 0.7071068, w: 0.7071068}
"""
CAMERA = Camera(width=640, height=480, fx=600.0, fy=601.0, cx=320.0, cy=240.0)


def load(tmp_path, text):
    (tmp_path / "arm.yaml").write_text(text)
    return Calibration.load(tmp_path / "arm.yaml")


def full(**more):
    residuals = np.array([[0.001, 0.01], [0.002, 0.02], [0.003, 0.03]])
    fields = {
        "mount": "eye_on_base",
        "pose": Pose(parent="base", child="camera", matrix=np.eye(4), covariance=np.diag([1e-6] * 3 + [1e-8] * 3)),
        "method": "Park",
        "board": Board(kind="chessboard", columns=9, rows=6, square_m=0.0236),
        "residuals": residuals,
        "leave_one_out": residuals / 10,
    }
    return Calibration(**fields | more)


def test_a_file_of_easy_handeye_is_read(tmp_path):
    found = load(tmp_path, FIRST)
    assert (found.mount, found.pose.parent, found.pose.child) == ("eye_in_hand", "iiwa_link_ee", "camera_optical")
    assert np.allclose(found.pose.matrix[:3, 3], [0.00117, 0.11323, 0.02148])
    wanted = Rotation.from_quat([-0.50621, -0.49197, -0.50190, 0.49991]).as_matrix()
    assert np.allclose(found.pose.matrix[:3, :3], wanted, atol=1e-12)
    assert (found.base_frame, found.board_frame, found.camera) == ("iiwa_link_0", "marker", None)


def test_a_file_of_easy_handeye2_is_read(tmp_path):
    (tmp_path / "arm.camera_info.yaml").write_text(
        yaml.safe_dump(
            {
                "image_width": 8,
                "image_height": 6,
                "k": [7, 0, 3, 0, 7, 2, 0, 0, 1],
                "d": [],
                "distortion_model": "plumb_bob",
            }
        )
    )
    found = load(tmp_path, SECOND)
    assert (found.mount, found.pose.parent, found.pose.child) == (
        "eye_on_base",
        "fr3_link0",
        "camera_color_optical_frame",
    )
    assert np.allclose(found.pose.matrix[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert found.camera == Camera(width=8, height=6, fx=7.0, fy=7.0, cx=3.0, cy=2.0)


@pytest.mark.medium
@settings(max_examples=40)
@given(values(Calibration))
def test_the_file_holds_everything(tmp_path_factory, calibration):
    path = tmp_path_factory.mktemp("calibration") / "arm.yaml"
    written = calibration.save(path)
    again = Calibration.load(path)
    for name in Calibration.model_fields:
        one, other = getattr(calibration, name), getattr(again, name)
        if name in ("pose", "board_pose") and one is not None:
            assert np.allclose(one.matrix, other.matrix, atol=1e-12)
            assert same(one.covariance, other.covariance)
            assert (one.parent, one.child, one.stamp if name == "pose" else None) == (
                other.parent,
                other.child,
                other.stamp,
            )
        else:
            assert same(one, other), name
    if calibration.camera is not None:
        assert lens_files.load(written[1]) == calibration.camera


def test_easy_handeye_knows_all_parameters_that_are_written():
    """It passes them on as keywords, so one that it does not know is an error there."""
    known = {
        "namespace",
        "move_group_namespace",
        "move_group",
        "eye_on_hand",
        "robot_base_frame",
        "robot_effector_frame",
        "tracking_base_frame",
        "tracking_marker_frame",
    }
    facts = yaml.safe_load(calibration_files.yaml(full()))
    assert facts["parameters"].keys() == known
    assert facts["transformation"] == {"x": 0, "y": 0, "z": 0, "qx": 0, "qy": 0, "qz": 0, "qw": 1}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[", "it is not YAML"),
        ("parameters: 3", "`parameters` hold no mapping"),
        (FIRST.replace("eye_on_hand: true", "eye_on_hand: maybe"), "has neither `eye_on_hand"),
        (FIRST.replace("transformation", "other"), "neither `transformation` nor `transform`"),
        (FIRST.replace("x: 0.00117", "x: far"), "no finite number"),
        (FIRST.replace("qw: 0.49991", "qw: 1.5"), "its quaternion has length"),
        (FIRST + "covariance: [1, 2]\n", "its covariance holds 2 numbers instead of 36"),
        (FIRST + "residuals: [1, 2, 3]\n", "not pairs of a distance and an angle"),
        (FIRST + "board: {kind: paper}\n", "the kind of its board is not one of chessboard"),
        (FIRST + "board: {kind: aruco}\n", "its board: square_m: Field required"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path, text, why):
    with pytest.raises(ArtifactError, match=r"`arm.yaml` cannot be read as easy_handeye YAML") as caught:
        load(tmp_path, text)
    assert why in caught.value.facts["why"]


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        ({"mount": "eye_in_hand"}, "DXB-A514", "eye_in_hand needs T_effector_camera, but T_base_camera came"),
        ({"base_frame": "robot"}, "DXB-A514", "eye_on_base needs T_robot_camera"),
        ({"board_pose": Pose(parent="base", child="board", matrix=np.eye(4))}, "DXB-A514", "needs T_effector_board"),
        ({"residuals": -np.ones((3, 2))}, "DXB-A515", "residuals: a distance is below 0"),
        ({"reprojection_px": np.ones(2)}, "DXB-A105", "axis K is 2, but residuals says 3"),
    ],
)
def test_parts_that_do_not_fit_are_refused(more, code, said):
    with pytest.raises(ArtifactError, match=said) as caught:
        full(**more)
    assert caught.value.code == code


def test_it_says_how_well_the_pose_is_known():
    assert list(full().facts()) == [
        "eye_on_base",
        "T_base_camera",
        "Park",
        "sigma 1.7 mm, 0.0099 deg",
        "3 observations",
        "residuals 2.2 mm, 1.2 deg RMS",
    ]
    assert full().observations() == 3


def test_the_picture_shows_every_residual():
    picture = np.asarray(Pillow.open(io.BytesIO(full().picture())))
    assert picture.shape == (240, 640, 3)
    for half in (picture[:, :320], picture[:, 320:]):
        blue = (half == COLOURS[0]).all(axis=-1).any(axis=0)
        dots = np.flatnonzero(np.diff(blue.astype(int)) == 1)
        assert len(dots) == 3  # one per observation
        assert (half == COLOURS[1]).all(axis=-1).any()
