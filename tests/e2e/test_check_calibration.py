"""`dxb check calibration`: a new picture against a calibration, by its exit code."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from dextera_build.geometry import lie, transforms
from tests.e2e.space import Space
from tests.geometry import hand_eyes
from tests.geometry.hand_eyes import Errors
from tests.rules.align.calibration import boards

ASKED = ("--input", "capture=before", "--input", "now=after")


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Space:
    space = Space(tmp_path_factory.mktemp("cell"))
    space.write("dxb.toml", "")
    return space


def written(space: Space, name: str, rows: slice, now: np.ndarray) -> None:
    """Pictures and poses of some of twelve views, the camera moved by `now` (4, 4)."""
    board = boards.MARKER
    views, _, _ = hand_eyes.simulate(
        4, 12, board=boards.corners(board), errors=Errors(0.0, 2e-4, 3e-4), k=boards.CAMERA.matrix(), away=False
    )
    entries = []
    for number, view in list(enumerate(views))[rows]:
        pixels = boards.drawn(board, transforms.invert(now) @ view.candidates[0], number)
        space.write(f"{name}/capture.json", "")
        Image.fromarray(pixels).save(space.root / name / f"rgb_{number}.png")
        turn = lie.rotation_vector(view.effector[:3, :3]).tolist()
        stated = {"t_m": view.effector[:3, 3].tolist(), "rotvec_rad": turn}
        entries.append({"rgb": f"rgb_{number}.png", "T_base_ee": stated})
    facts = {
        **boards.CAMERA.model_dump(),
        "setup": "eye-to-hand",
        "target": {"type": "AprilTag 36h11", "size_m": board.square_m, "mounted": "gripper"},
        "views": entries,
    }
    space.write(f"{name}/capture.json", json.dumps(facts))


@pytest.mark.slow
def test_the_exit_code_says_whether_the_camera_moved(space: Space) -> None:
    written(space, "before", slice(0, 9), np.eye(4))
    written(space, "after", slice(9, 12), np.eye(4))
    still = space.dxb("check", "calibration", "capture/camera_moved:moved", *ASKED)
    assert (still.code, "unmoved" in still.out) == (0, True), still.err
    away = transforms.rigid(lie.rotation(np.array([0.0, 0.0175, 0.0])), np.array([0.02, 0.0, 0.0]))
    written(space, "after", slice(9, 12), away)
    moved = space.dxb("check", "calibration", "capture/camera_moved:moved", *ASKED, "--json")
    assert (moved.code, moved.rows[0]["moved"], "moved: the board is" in moved.out) == (1, True, True), moved.err
    unsure = space.dxb("check", "calibration", "capture/camera_moved:moved", *ASKED, "--set", "moved.notable_m=0.00001")
    assert unsure.code == 1  # what is sure to have moved is not unsure
    written(space, "after", slice(9, 12), np.eye(4))
    unsure = space.dxb("check", "calibration", "capture/camera_moved:moved", *ASKED, "--set", "moved.notable_m=0.00001")
    assert (unsure.code, "unsure" in unsure.out) == (3, True), unsure.err


@pytest.mark.slow
def test_a_node_of_another_rule_is_refused(space: Space) -> None:
    answer = space.dxb("check", "calibration", "capture/camera_moved:views", *ASKED)
    assert answer.code == 2
    assert "detects no motion" in answer.err
    assert space.dxb("check", "calibration").code == 2
