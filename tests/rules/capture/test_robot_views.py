"""Calibration captures in folders: what comes out of good ones, and the error of every wrong field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.cameras.image import png
from dextera_build.errors import RuleError
from dextera_build.geometry import poses
from dextera_build.testing import RuleRunner
from tests.rules.capture.test_phone import SIZED, jpeg

REAL = Path(__file__).parents[4] / "shared" / "captures"
TURNS = ([0.1, 0.2, 0.3], [2.0, -1.0, 0.5], [-0.4, 3.0, 0.2])
CHARUCO = {"type": "charuco", "squares": [5, 7], "square_m": 0.03, "marker_m": 0.022, "dictionary": "DICT_5X5_100"}


@pytest.fixture
def runner(tmp_path):
    return RuleRunner(tmp_path)


def view(number: int, **changes: object) -> dict[str, Any]:
    pose = {"t_m": [0.4, 0.01 * number, 0.3], "rotvec_rad": TURNS[number]}
    found = {"rgb": f"rgb_{number}.png", "T_base_ee": pose, **changes}
    return {key: value for key, value in found.items() if value is not None}


def facts(views: object = None, **changes: object) -> dict[str, Any]:
    """A good `capture.json`, with fields replaced or (None) taken out."""
    chosen = [view(number) for number in range(3)] if views is None else views
    found = {**SIZED, "setup": "eye-to-hand", "target": {**CHARUCO, "mounted": "gripper"}, "views": chosen, **changes}
    return {key: value for key, value in found.items() if value is not None}


def folder(found: dict[str, Any], **more: bytes | None) -> Folder:
    """Its folder with three pictures; `__` in a name stands for the dot."""
    pictures = {f"rgb_{n}.png": png(np.full((48, 64, 3), 60 + 10 * n, np.uint8)) for n in range(3)}
    files: dict[str, bytes | None] = {"capture.json": json.dumps(found).encode(), **pictures}
    files |= {name.replace("__", "."): data for name, data in more.items()}
    return Folder(files={name: data for name, data in files.items() if data is not None})


def refused(runner: RuleRunner, found: dict[str, Any], **more: bytes | None) -> RuleError:
    with pytest.raises(RuleError) as caught:
        runner.run("capture.robot_views", folder=folder(found, **more))
    return caught.value


def test_poses_are_those_of_the_rotation_vectors(runner):
    found = runner.run("capture.robot_views", folder=folder(facts()))
    assert list(found.captures) == ["rgb_0", "rgb_1", "rgb_2"]
    assert (found.mount, found.joints, found.skew_s) == ("eye_on_base", None, None)
    for number, row in enumerate(found.effectors):
        motion = poses.to_matrix(row)
        np.testing.assert_allclose(motion[:3, :3], Rotation.from_rotvec(TURNS[number]).as_matrix(), atol=1e-12)
        np.testing.assert_allclose(motion[:3, 3], [0.4, 0.01 * number, 0.3])
    assert not runner.outcome.warnings


def test_a_quaternion_is_the_same_pose(runner):
    turns = [np.roll(Rotation.from_rotvec(turn).as_quat(), 1).tolist() for turn in TURNS]
    views = [view(n, T_base_ee={"t_m": [0.4, 0.01 * n, 0.3], "quat_wxyz": turn}) for n, turn in enumerate(turns)]
    one, other = (runner.run("capture.robot_views", folder=folder(each)).effectors for each in (facts(), facts(views)))
    signs = np.sign((one[:, 3:] * other[:, 3:]).sum(axis=1))
    np.testing.assert_allclose(one[:, 3:], other[:, 3:] * signs[:, None], atol=1e-9)


def test_joints_keep_their_names_stamps_and_skew(runner):
    views = [
        view(n, joints={"b": 0.1 * n, "a": -0.2}, stamp_s=10.0 + n, skew_s=0.004, T_base_ee=None) for n in range(3)
    ]
    views[1]["joints"] = dict(reversed(views[1]["joints"].items()))  # an object has no order
    found = runner.run("capture.robot_views", folder=folder(facts(views)))
    assert found.effectors is None
    assert found.joints.names == ("b", "a")
    np.testing.assert_allclose(found.joints.positions, [[0.0, -0.2], [0.1, -0.2], [0.2, -0.2]])
    np.testing.assert_allclose(found.joints.stamps, [10, 11, 12])
    np.testing.assert_allclose(found.skew_s, 0.004)


def test_each_view_has_its_depth(runner):
    depths = {f"depth_{n}__png": png(np.full((48, 64), 500 + 100 * n, np.uint16)) for n in range(3)}
    views = [view(n, depth=f"depth_{n}.png") for n in range(3)]
    found = runner.run("capture.robot_views", folder=folder(facts(views, depth_scale_m=0.001), **depths))
    seen = [each.measured.depth.depth[4, 4] for each in found.captures.values()]
    np.testing.assert_allclose(seen, [0.5, 0.6, 0.7], rtol=1e-6)


def test_pictures_are_turned_as_their_exif_says(runner):
    pixels = np.zeros((64, 48, 3), np.uint8)
    pixels[:16, 32:] = 250
    views = [view(n, rgb=f"p{n}.jpg") for n in range(3)]
    pictures = {f"p{n}__jpg": jpeg(pixels, orientation=8) for n in range(3)}
    found = runner.run("capture.robot_views", folder=folder(facts(views), **pictures))
    rgb = found.captures["p0"].photograph.rgb.pixels
    assert rgb.shape == (48, 64, 3)
    assert rgb[4, 4, 0] > 200 > rgb[-4, 4, 0]


@pytest.mark.parametrize(
    ("target", "board"),
    [
        (CHARUCO, Board(kind="charuco", columns=5, rows=7, square_m=0.03, marker_m=0.022, dictionary="DICT_5X5_100")),
        (
            {"type": "chessboard", "inner_corners": [9, 6], "square_m": 0.0236},
            Board(kind="chessboard", columns=9, rows=6, square_m=0.0236),
        ),
        (
            {"type": "circles grid", "circles": [7, 5], "spacing_m": 0.025},
            Board(kind="circles", columns=7, rows=5, square_m=0.025),
        ),
        (
            {"type": "asymmetric circles", "circles": [4, 11], "spacing_m": 0.014},
            Board(kind="asymmetric_circles", columns=4, rows=11, square_m=0.014),
        ),
        ({"type": "AprilTag 36h11", "size_m": 0.048}, Board(kind="apriltag", square_m=0.048, dictionary="36h11")),
        (
            {"type": "aruco", "dictionary": "dict_4x4_50", "size_m": 0.05},
            Board(kind="aruco", square_m=0.05, dictionary="DICT_4X4_50"),
        ),
        (
            {"type": "apriltag", "dictionary": "tag36h11", "size_m": 0.04, "gap_m": 0.01, "markers": [6, 5]},
            Board(kind="apriltag", columns=6, rows=5, square_m=0.05, marker_m=0.04, dictionary="36h11"),
        ),
    ],
)
def test_every_kind_of_board_is_read(runner, target, board):
    assert runner.run("capture.robot_views", folder=folder(facts(target=target))).board == board


def broken(number: int, key: str, value: object) -> list[dict[str, Any]]:
    """Views, one of which has a field, `T_base_ee.t_m`, replaced."""
    views = [view(n) for n in range(3)]
    place: Any = views[number]
    *above, last = key.split(".")
    for name in above:
        place = place[name]
    place[last] = value
    return views


@pytest.mark.parametrize(
    ("changes", "field", "says"),
    [
        ({"setup": None}, "setup", "eye-in-hand"),
        ({"setup": "eye"}, "setup", "eye-in-hand"),
        ({"target": {"type": "rings"}}, "target.type", "charuco"),
        ({"target": {**CHARUCO, "squares": [5]}}, "target.squares", "two whole numbers"),
        ({"target": {**CHARUCO, "square_m": 30}}, "target.square_m", "divide millimetres by 1000"),
        ({"target": {**CHARUCO, "marker_m": 0.03}}, "target.marker_m", "less than `square_m`"),
        ({"target": {**CHARUCO, "dictionary": "5x5"}}, "target.dictionary", "DICT_5X5_100"),
        ({"target": {"type": "AprilTag 36h11"}}, "target.size_m", "metres"),
        ({"views": []}, "views", "for each picture"),
        ({"views": [{"rgb": "rgb_0.png"}]}, "views[0].T_base_ee", "joints"),
        ({"views": broken(1, "rgb", 3)}, "views[1].rgb", "name of a file"),
        ({"views": broken(2, "rgb", "rgb_0.png")}, "views[2].rgb", "views[0]"),
        ({"views": broken(1, "T_base_ee.t_m", [1, 2])}, "views[1].T_base_ee.t_m", "three numbers"),
        ({"views": broken(1, "T_base_ee.t_m", [400, 20, 300])}, "views[1].T_base_ee.t_m", "divide millimetres"),
        ({"views": broken(2, "T_base_ee.rotvec_rad", [90, 0, 0])}, "views[2].T_base_ee.rotvec_rad", "divide degrees"),
        ({"views": broken(2, "T_base_ee.quat_wxyz", [1, 1, 0, 0])}, "views[2].T_base_ee.quat_wxyz", "length 1"),
        ({"views": broken(0, "joints", {"a": 1.0})}, "views[1].joints", "every view"),
        ({"views": broken(0, "joints", {"a": "1"})}, "views[0].joints.a", "radians"),
        ({"views": broken(0, "stamp_s", 1.0)}, "views[1].stamp_s", "every view"),
    ],
)
def test_a_wrong_field_is_named(runner, changes, field, says):
    error = refused(runner, facts(**changes))
    assert f"`{field}`" in error.message or field == "setup"
    assert says in error.message + error.facts["wanted"]


def test_joints_that_change_are_refused(runner):
    views = [view(n, joints={"a": 0.0, "b": 0.1 * n}) for n in range(3)]
    views[2]["joints"] = {"a": 0.0, "c": 0.1}
    error = refused(runner, facts(views))
    assert "`views[2].joints`" in error.message
    assert "b" in error.facts["wanted"]


def test_a_missing_or_damaged_picture_is_named(runner):
    error = refused(runner, facts(), rgb_1__png=None)
    assert error.message == "`rgb_1.png` is missing in the capture"
    assert error.facts["wanted"] == "`views[1].rgb`"
    assert refused(runner, facts(), rgb_2__png=b"gif").message == "`rgb_2.png` is not a PNG or JPEG image"


def test_a_board_that_moves_with_the_camera_is_refused(runner):
    error = refused(runner, facts(setup="eye-in-hand"))
    assert "never moves in the picture" in error.message
    assert (error.facts["setup"], error.facts["mounted"]) == ("eye-in-hand", "gripper")


def test_one_pose_and_a_robot_that_stood_still_are_flagged(runner):
    runner.run("capture.robot_views", folder=folder(facts([view(0)])))
    assert "one pose only" in runner.outcome.warnings[0]
    still = [view(n, T_base_ee=view(0)["T_base_ee"]) for n in range(3)]
    runner.run("capture.robot_views", folder=folder(facts(still)))
    assert "views[1], views[2]" in runner.outcome.warnings[0]


@pytest.mark.parametrize(
    ("name", "mount", "kind"),
    [("franka_eye_to_hand", "eye_on_base", "apriltag"), ("franka_eye_in_hand", "eye_in_hand", "chessboard")],
)
def test_real_captures_are_read(runner, name, mount, kind):
    if not (REAL / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    files = {path.name: path.read_bytes() for path in (REAL / name).iterdir()}
    found = runner.run("capture.robot_views", folder=Folder(files=files))
    assert (len(found.captures), found.mount, found.board.kind) == (8, mount, kind)
    np.testing.assert_allclose(np.linalg.norm(found.effectors[:, 3:], axis=1), 1.0)
    assert not runner.outcome.warnings


def textured(number: int) -> np.ndarray:
    random = np.random.default_rng(number)
    board = np.kron(random.integers(0, 2, (12, 16)), np.ones((4, 4))) * 170 + 40
    return np.repeat((board + random.normal(0, 2, board.shape)).astype(np.uint8)[..., None], 3, axis=2)


def pictured(**changed: np.ndarray) -> Folder:
    """Three sharp pictures, some of them replaced."""
    pictures = {f"rgb_{n}": textured(n) for n in range(3)} | changed
    return folder(facts(), **{f"{name}__png": png(pixels) for name, pixels in pictures.items()})


def test_blurred_and_dark_pictures_are_flagged(runner):
    runner.run("capture.robot_views", folder=pictured())
    assert not runner.outcome.warnings
    swept = np.stack([ndimage.uniform_filter1d(textured(1)[..., n].astype(float), 9, axis=1) for n in range(3)], axis=2)
    runner.run("capture.robot_views", folder=pictured(rgb_1=swept.astype(np.uint8)))
    (warning,) = runner.outcome.warnings
    assert "blurred" in warning
    assert "rgb_1 (" in warning
    runner.run("capture.robot_views", folder=pictured(rgb_2=(textured(2) * 0.15).astype(np.uint8)))
    (warning,) = runner.outcome.warnings
    assert warning.startswith("rgb_2: too dark")


@pytest.mark.parametrize("name", ["franka_eye_to_hand", "franka_eye_in_hand"])
def test_a_blurred_picture_of_a_real_capture_is_flagged(runner, name):
    if not (REAL / name).is_dir():
        pytest.skip(f"needs shared/captures/{name}")
    cv2 = pytest.importorskip("cv2")
    files = {path.name: path.read_bytes() for path in (REAL / name).iterdir()}
    pixels = cv2.imdecode(np.frombuffer(files["rgb_3.png"], np.uint8), cv2.IMREAD_COLOR)
    files["rgb_3.png"] = cv2.imencode(".png", cv2.GaussianBlur(pixels, (0, 0), 2.0))[1].tobytes()
    runner.run("capture.robot_views", folder=Folder(files=files))
    (warning,) = runner.outcome.warnings
    assert "rgb_3 (" in warning
    assert warning.count("rgb_") == 1
