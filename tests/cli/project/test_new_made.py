"""`dxb new board`, `new capture` and `new robot`: what they write is read by the rules at once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.cli.project import new_capture
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests.e2e.space import Space
from tests.rules.simulate.robot_files import ARM, arm, hand


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path / "project")
    made.write("dxb.toml", 'cache = "cache"\n')
    return made


def test_a_board_is_written_with_what_a_capture_says_about_it(space):
    answer = space.dxb("new", "board")
    assert (answer.code, answer.out) == (0, "board.pdf\n")
    assert (space.root / "board.pdf").read_bytes().startswith(b"%PDF-1.7")
    said = json.loads("{" + answer.err[answer.err.index('"target"') :] + "}")
    board = dict(new_capture.template()["target"])  # type: ignore[call-overload]
    assert said["target"] | {"mounted": "gripper"} == board
    again = space.dxb("new", "board")
    assert again.code == 2
    assert "`board.pdf` exists already" in again.err


def test_boards_of_every_pattern_are_as_large_as_the_paper_allows(space):
    for words, says in {
        ("chessboard", "--paper", "letter"): '"square_m": 0.0',
        ("apriltag", "--columns", "4", "--rows", "3", "--paper", "a3"): '"markers": [4, 3]',
        ("aruco", "--square", "80"): '"size_m": 0.08',
    }.items():
        answer = space.dxb("new", "board", *words, "-o", f"{words[0]}.pdf")
        assert answer.code == 0, answer.err
        assert says in answer.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("board", "circles"), "`circles` is not a board"),
        (("board", "--square", "90"), "does not fit on a4"),
        (("board", "--columns", "0"), "positive counts"),
        (("recipe", "twin/a", "--paper", "a4"), "no paper"),
        (("recipe", "twin/a", "--repair-inertias"), "no inertias"),
        (("recipe",), "a recipe takes a name"),
        (("capture",), "takes the name of its folder"),
        (("robot", "none.urdf"), "there is no file `none.urdf`"),
    ],
)
def test_wrong_words_are_refused(space, words, says):
    answer = space.dxb("new", *words)
    assert answer.code in (1, 2), answer.err
    assert says in answer.err


@pytest.mark.medium
def test_a_filled_template_is_a_capture(space, tmp_path):
    answer = space.dxb("new", "capture", "calibration")
    assert answer.out.splitlines() == ["calibration/capture.json", "calibration/README.md"]
    facts = json.loads((space.root / "calibration" / "capture.json").read_text())
    runner = RuleRunner(tmp_path)
    with pytest.raises(RuleError) as empty:
        runner.run("capture.robot_views", folder=Folder(files={"capture.json": json.dumps(facts).encode()}))
    assert "`rgb_01.png` is missing" in empty.value.message
    files = {}
    facts |= {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}
    for number, view in enumerate(facts["views"]):
        view["T_base_ee"] = {"t_m": [0.4, 0.01 * number, 0.3], "rotvec_rad": [0.2 * number, 0.1, 0.0]}
        view["joints"] = {"joint_1": 0.1 * number, "joint_2": -0.2}
        files[view["rgb"]] = png(np.random.default_rng(number).integers(0, 255, (48, 64, 3), np.uint8))
        files[view["depth"]] = png(np.full((48, 64), 800, np.uint16))
    files["capture.json"] = json.dumps(facts).encode()
    found = runner.run("capture.robot_views", folder=Folder(files=files))
    assert len(found.captures) == new_capture.VIEWS
    assert (found.effector_frame, found.board.kind, found.joints.names) == ("flange", "charuco", ("joint_1", "joint_2"))


@pytest.mark.slow
def test_a_recipe_for_a_urdf_builds_at_once(space):
    for name, data in arm().files.items():
        path = space.root / "robots" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    answer = space.dxb("new", "robot", "robots/arm_description/urdf/arm.urdf")
    assert (answer.code, answer.out) == (0, "recipes/robot/arm.yaml\n"), answer.err
    text = (space.root / "recipes" / "robot" / "arm.yaml").read_text()
    assert "hand: [tool0]" in text
    assert "files: robots/arm_description\n" in text
    for role in ("palm: {link: tool0", "flange: {link: tool0", "tip_left: {link: left", "tip_right: {link: right"):
        assert role in text
    assert text.count("# guess") >= 3
    built = space.dxb("build", "robot/arm", "--console", "none")
    assert built.code == 0, built.err


@pytest.mark.slow
def test_a_recipe_for_an_mjcf_has_its_keyframe_as_home(space, tmp_path):
    for name, data in hand().files.items():
        path = tmp_path / "elsewhere" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    answer = space.dxb("new", "robot", str(tmp_path / "elsewhere" / "hand.xml"))
    assert answer.code == 0, answer.err
    text = (space.root / "recipes" / "robot" / "hand.yaml").read_text()
    assert "velocity_rad_s: 2.0  # guess" in text
    assert "one: 0.2" in text
    built = space.dxb("build", "robot/hand", "--console", "none")
    assert built.code == 0, built.err


def test_a_missing_mesh_is_named(space):
    space.write("arm.urdf", ARM)
    answer = space.dxb("new", "robot", "arm.urdf")
    assert answer.code != 0
    assert "mesh `package://arm_description/meshes/cube.stl` is missing" in answer.err
