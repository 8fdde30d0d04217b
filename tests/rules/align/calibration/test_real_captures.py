"""align.hand_eye on photographs of a real robot; skipped where they are absent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dextera_build.api import Project
from dextera_build.artifacts.cameras.calibration import Board, Calibration
from dextera_build.artifacts.cameras.camera import Camera, Capture, Photograph
from dextera_build.artifacts.cameras.image import Image as Picture
from dextera_build.artifacts.robots.robot_views import RobotViews
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.errors import RuleError
from dextera_build.geometry import hand_eye, hand_eye_refine, lie, poses, transforms
from dextera_build.testing import RuleRunner
from rules.align.calibration import detection

CAPTURES = Path(__file__).parents[5] / "shared" / "captures"
TAG = Board(kind="apriltag", square_m=0.048, dictionary="36h11")
CHESS = Board(kind="chessboard", columns=9, rows=6, square_m=0.0236)
LARGER = CHESS.model_copy(update={"square_m": 0.0262})
"""With the squares that the tutorial of the capture's source states for this board."""


def views(name: str, board: Board) -> RobotViews:
    folder = CAPTURES / name
    if not folder.is_dir():
        pytest.skip(f"no capture {name}")
    facts = json.loads((folder / "capture.json").read_text())
    camera = Camera(**{key: facts[key] for key in ("width", "height", "fx", "fy", "cx", "cy")})
    captures, rows = {}, []
    for view in facts["views"]:
        pixels = np.asarray(Image.open(folder / view["rgb"]).convert("RGB"))
        captures[Path(view["rgb"]).stem] = Capture(photograph=Photograph(rgb=Picture(pixels=pixels), camera=camera))
        stated = view["T_base_ee"]
        turn = lie.rotation(np.array(stated["rotvec_rad"]))
        rows.append(poses.from_matrix(transforms.rigid(turn, np.array(stated["t_m"]))))
    mount = "eye_in_hand" if facts["setup"] == "eye-in-hand" else "eye_on_base"
    return RobotViews(captures=captures, mount=mount, effectors=np.stack(rows), board=board)


def spread(views: RobotViews, found: Calibration) -> np.ndarray:
    """Standard deviation (3,) [mm] of the board's place by single pictures, in the effector or the base."""
    assert views.effectors is not None
    assert views.board is not None
    assert found.board_pose is not None
    solution = hand_eye.Solution(found.pose.matrix, found.board_pose.matrix)
    places = []
    for row, capture in zip(views.effectors, views.captures.values(), strict=True):
        k = capture.photograph.camera.matrix()
        setup = hand_eye.Setup(k, views.mount == "eye_in_hand")
        sighting = detection.look(capture.photograph.rgb.pixels, k, views.board, "edges").sighting
        assert sighting is not None
        view = hand_eye.View("", poses.to_matrix(row), sighting.board, sighting.pixels, (), sighting.orders)
        best = min(hand_eye.ordered(view), key=lambda each: float((hand_eye.offsets(solution, each, setup) ** 2).sum()))
        alone = hand_eye_refine.alone(best, setup, hand_eye.predicted(solution, best, setup))
        places.append((transforms.invert(hand_eye.robot_side(view, setup)) @ solution.x @ alone)[:3, 3])
    return 1000 * np.std(places, axis=0)


@pytest.mark.medium
def test_a_fixed_camera_sees_a_tag_on_the_gripper(tmp_path: Path) -> None:
    capture = views("franka_eye_to_hand", TAG)
    found = RuleRunner(tmp_path).run("align.hand_eye", views=capture)
    assert found.observations() == 8
    assert (np.sort(spread(capture, found)) < [1.5, 2.8, 3.0]).all()
    assert found.leave_one_out is not None
    assert found.leave_one_out[:, 0].max() < 0.004


@pytest.mark.medium
def test_a_camera_on_the_gripper_sees_a_chessboard(tmp_path: Path) -> None:
    capture = views("franka_eye_in_hand", LARGER)
    found = RuleRunner(tmp_path).run("align.hand_eye", views=capture)
    assert found.observations() == 8
    assert (np.sort(spread(capture, found)) < [1.7, 1.8, 3.6]).all()


@pytest.mark.slow
def test_the_size_that_is_stated_for_the_chessboard_contradicts_the_robot(tmp_path: Path) -> None:
    with pytest.raises(RuleError, match=r"the board is 1\.1\d\d times as large as stated"):
        RuleRunner(tmp_path).run("align.hand_eye", views=views("franka_eye_in_hand", CHESS))


@pytest.mark.slow
def test_the_recipe_reads_a_real_capture_as_it_is(tmp_path: Path) -> None:
    folder = CAPTURES / "franka_eye_to_hand"
    if not folder.is_dir():
        pytest.skip("no capture franka_eye_to_hand")
    project = Project.find(tmp_path, cache=str(tmp_path / "cache"))
    built = project.build("capture/calibration", "calibration", "mount", inputs={"capture": str(folder)})
    assert built.ok, built.errors
    found, mount = built.artifact("calibration"), built.artifact("mount")
    assert isinstance(found, Calibration)
    assert isinstance(mount, Pose)
    assert found.observations() == 8
    assert np.allclose(mount.matrix, transforms.invert(found.pose.matrix))
