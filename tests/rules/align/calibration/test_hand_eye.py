"""align.hand_eye: drawn boards of all kinds, and everything that is wrong with a capture by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.errors import RuleError
from dextera_build.geometry import boards as layout
from dextera_build.geometry import lie, poses, transforms
from dextera_build.testing import RuleRunner
from rules.align.calibration import detection
from tests.rules.align.calibration import boards


def solved(tmp_path: Path, views: RobotViews, **options: object) -> tuple[Calibration, RuleRunner]:
    runner = RuleRunner(tmp_path)
    found = runner.run("align.hand_eye", views=views, options=options)
    assert isinstance(found, Calibration)
    return found, runner


def refused(tmp_path: Path, views: RobotViews, match: str, **inputs: object) -> RuleError:
    with pytest.raises(RuleError, match=match) as caught:
        RuleRunner(tmp_path).run("align.hand_eye", views=views, **inputs)
    return caught.value


KINDS = [boards.MARKER, boards.GRID, boards.CHARUCO, boards.CHESS, boards.CIRCLES, boards.ASYMMETRIC]


@pytest.mark.medium
@pytest.mark.parametrize(
    ("board", "in_hand"),
    [
        # Half of the pairs have every kind and both mounts.
        pytest.param(
            board, in_hand, marks=[pytest.mark.slow] if (number + in_hand) % 2 else [], id=f"{board.kind}-{mount}"
        )
        for number, board in enumerate(KINDS)
        for in_hand, mount in ((False, "eye_on_base"), (True, "eye_in_hand"))
    ],
)
def test_every_kind_of_board_gives_the_camera(tmp_path: Path, board: object, in_hand: bool) -> None:
    views, truth = boards.taken(board, in_hand=in_hand)
    found, runner = solved(tmp_path, views)
    distance, angle = boards.off(found.pose.matrix, truth.x)
    assert distance < 2.0
    assert angle < 0.15
    assert found.pose.covariance is not None
    assert found.leave_one_out is not None
    assert len(found.leave_one_out) == found.observations() >= 7
    assert [caption for caption, _ in runner.outcome.previews] == [
        "residuals (blue) and change without (orange)",
        "board as the robot's pose implies it (axes, green), and as seen (red)",
    ]


@pytest.mark.medium
@pytest.mark.parametrize("board", [boards.MARKER, boards.GRID], ids=["one", "grid"])
def test_edges_place_corners_where_corner_detectors_err(board: object) -> None:
    views, truth = boards.taken(board, seed=3, count=6)
    off: dict[str, list[float]] = {"edges": [], "subpixel": []}
    for row, (_, capture) in zip(views.effectors, views.captures.items(), strict=True):  # type: ignore[arg-type]
        seen = transforms.invert(truth.x) @ poses.to_matrix(row) @ truth.y
        for how, errors in off.items():
            sighting = detection.look(capture.photograph.rgb.pixels, boards.CAMERA.matrix(), board, how).sighting
            assert sighting is not None
            alone = sighting.candidates[0]
            errors.append(abs(np.linalg.norm(alone[:3, 3]) / np.linalg.norm(seen[:3, 3]) - 1))
    assert np.median(off["edges"]) < 0.3 * np.median(off["subpixel"])


def test_rotation_about_one_axis_is_refused_with_the_singular_values(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER, axes=(0.0, 0.0, 1.0))
    error = refused(tmp_path, views, "turns about one axis only")
    assert "deg" in str(error.facts["rotation by axis"])
    assert "axes across that one" in str(error.hint)


def test_one_pose_is_refused(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    one = views.model_copy(update={"effectors": np.repeat(views.effectors[:1], len(views.effectors), axis=0)})
    refused(tmp_path, one, "hardly turns between the pictures")
    few = views.model_copy(
        update={"captures": dict(list(views.captures.items())[:1]), "effectors": views.effectors[:1]}
    )
    refused(tmp_path, few, "the board is seen in 1 of 1 pictures, 5 are needed")


@pytest.mark.medium
def test_a_board_of_another_size_is_refused_with_its_size(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    stated = boards.MARKER.model_copy(update={"square_m": 1.08 * boards.MARKER.square_m})
    error = refused(tmp_path, views.model_copy(update={"board": stated}), r"the board is 0\.9\d\d times as large")
    assert "ruler" in str(error.hint)


@pytest.mark.medium
def test_markers_from_right_to_left_are_refused(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.GRID, reverse=True)
    refused(tmp_path, views, "the markers are numbered from right to left")


def test_a_mirrored_picture_is_told(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    captures = {
        name: boards.capture(np.ascontiguousarray(each.photograph.rgb.pixels[:, ::-1]))
        for name, each in views.captures.items()
    }
    error = refused(tmp_path, views.model_copy(update={"captures": captures}), "the board is seen in 0 of 8")
    assert "mirrored" in str(error.facts["`view_0`"])


@pytest.mark.medium
def test_another_board_is_refused(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.GRID)
    other = boards.GRID.model_copy(update={"columns": 3, "rows": 4})
    refused(tmp_path, views.model_copy(update={"board": other}), "not the stated one")


def test_millimetres_are_told(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    rows = views.effectors * [1000, 1000, 1000, 1, 1, 1, 1]
    refused(tmp_path, views.model_copy(update={"effectors": rows}), "look like millimetres")


@pytest.mark.medium
def test_inverted_poses_are_told(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    rows = np.stack([poses.from_matrix(transforms.invert(poses.to_matrix(row))) for row in views.effectors])
    refused(tmp_path, views.model_copy(update={"effectors": rows}), "poses are those of the base in the effector")


@pytest.mark.slow
@pytest.mark.parametrize("order", ["xyz", "ZYX"])
def test_euler_angles_are_told_in_both_directions(tmp_path: Path, order: str) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    motions = [poses.to_matrix(row) for row in views.effectors]
    as_vectors = [Rotation.from_matrix(m[:3, :3]).as_euler(order) for m in motions]
    as_angles = [Rotation.from_matrix(m[:3, :3]).as_rotvec() for m in motions]
    wrong = {
        "that are Euler angles about": [lie.rotation(angles) for angles in as_vectors],
        "were read as Euler angles about": [Rotation.from_euler(order, vector).as_matrix() for vector in as_angles],
    }
    for text, turns in wrong.items():
        rows = [transforms.rigid(turn, m[:3, 3]) for turn, m in zip(turns, motions, strict=True)]
        changed = views.model_copy(update={"effectors": np.stack([poses.from_matrix(row) for row in rows])})
        error = refused(tmp_path, changed, text)
        assert f"axes {order.lower()}" in str(error)


@pytest.mark.slow
def test_a_cause_that_does_not_explain_the_pictures_is_not_named(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    random = Rotation.random(len(views.effectors), random_state=3).as_matrix()
    rows = [transforms.rigid(turn, row[:3]) for turn, row in zip(random, views.effectors, strict=True)]
    changed = views.model_copy(update={"effectors": np.stack([poses.from_matrix(row) for row in rows])})
    error = refused(tmp_path, changed, "contradict each other")
    assert "then" not in error.facts
    assert "names and order of the joints" in str(error.hint)


@pytest.mark.medium
def test_a_chessboard_that_the_border_cuts_is_told_with_what_is_seen() -> None:
    views, _ = boards.taken(boards.CHESS)
    pixels = next(iter(views.captures.values())).photograph.rgb.pixels
    k = boards.CAMERA.matrix()
    whole = detection.look(pixels, k, boards.CHESS, "edges").sighting
    assert whole is not None
    right = int(np.quantile(whole.pixels[:, 0], 0.97))
    found = detection.look(np.ascontiguousarray(pixels[:, :right]), k, boards.CHESS, "edges")
    assert found.sighting is None
    assert "inner corners are seen: the border of the picture or something in front cuts the board" in found.found


@pytest.mark.slow
def test_poses_of_the_picture_before_are_told(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER)
    assert views.effectors is not None
    shifted = views.model_copy(update={"effectors": np.roll(views.effectors, 1, axis=0)})
    refused(tmp_path, shifted, "each picture has the pose of one picture later|one picture earlier")


@pytest.mark.slow
def test_a_moved_picture_and_a_dark_one_are_left_out_by_name(tmp_path: Path) -> None:
    views, truth = boards.taken(boards.MARKER, count=9)
    assert views.effectors is not None
    rows = views.effectors.copy()
    rows[2, :3] += [0.03, 0.0, 0.01]
    captures = dict(views.captures)
    captures["view_4"] = boards.capture((captures["view_4"].photograph.rgb.pixels * 0.01).astype(np.uint8))
    found, runner = solved(tmp_path, views.model_copy(update={"effectors": rows, "captures": captures}))
    assert found.observations() == 7
    text = " ".join(runner.outcome.warnings)
    assert "`view_2` contradicts the other pictures" in text
    assert "`view_4` is left out: too dark" in text
    assert boards.off(found.pose.matrix, truth.x)[0] < 3.0


def test_the_layout_is_opencvs() -> None:
    import cv2

    grid = boards.GRID
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    theirs = cv2.aruco.GridBoard((4, 3), grid.marker_m, grid.square_m - grid.marker_m, family)
    np.testing.assert_allclose(layout.markers(4, 3, grid.square_m, grid.marker_m), theirs.getObjPoints(), atol=1e-7)


def test_the_stub_gives_a_pose(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER, count=3)
    found = RuleRunner(tmp_path).run("align.hand_eye", backend="stub", profile="stub", views=views)
    assert found.method == "fixed"


def test_a_capture_without_a_board_is_refused(tmp_path: Path) -> None:
    views, _ = boards.taken(boards.MARKER, count=3)
    refused(tmp_path, views.model_copy(update={"board": None}), "states no board")
