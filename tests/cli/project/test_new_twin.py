"""`dxb new twin`: recipes for a photograph and for a moved camera."""

from __future__ import annotations

import shlex

import pytest

from tests.e2e.space import Space
from tests.e2e.test_bad_captures import write_capture


@pytest.fixture
def project(tmp_path):
    space = Space(tmp_path)
    assert space.dxb("init", ".").code == 0
    (tmp_path / "captures").mkdir()
    write_capture(tmp_path / "captures" / "desk")
    write_capture(tmp_path / "capture_now")
    return space


@pytest.mark.medium
def test_a_moved_camera_is_planned_by_the_command_that_is_printed(project):
    answer = project.dxb("new", "twin", "twin/desk")
    assert (answer.code, answer.out) == (0, "recipes/twin/desk.yaml\n")
    assert answer.err == (
        "  put a photograph into `captures/desk`: rgb.png, depth.png and capture.json; then: dxb build twin/desk\n"
    )
    assert project.dxb("plan", "twin/desk").code == 0
    answer = project.dxb("new", "twin", "twin/desk", "--moved-camera")
    assert (answer.code, answer.out) == (0, "recipes/twin/desk_again.yaml\n")
    (command,) = (line.partition("dxb ")[2] for line in answer.err.splitlines() if "then:" in line)
    assert command == "build twin/desk_again --input now=FOLDER"
    words = shlex.split(command.replace("FOLDER", "capture_now").replace("build", "plan"))
    planned = project.dxb(*words)
    assert planned.code == 0, planned.err
    rules = {line.split("\t")[2] for line in planned.out.splitlines()}
    assert {"align.scene", "align.camera", "capture.pair", "align.track", "align.moved"} <= rules
    assert project.dxb("new", "twin", "twin/desk", "--moved-camera").code == 2


def test_what_is_no_twin_is_refused(project):
    for words, code in (
        (["twin", "robot/panda", "--moved-camera"], "DXB-U214"),
        (["twin", "twin/nothing", "--moved-camera"], "DXB-U108"),
        (["twin", "desk"], "DXB-U192"),
        (["recipe", "twin/a", "--moved-camera"], "DXB-U217"),
    ):
        answer = project.dxb("new", *words)
        assert (answer.code, f"error[{code}]" in answer.err) == (2, True), answer.err


def test_a_recipe_elsewhere_is_spoken_of_by_its_address(project):
    answer = project.dxb("new", "twin", "twin/p", "-o", "recipes/other/p.yaml")
    assert (answer.code, "then: dxb build other/p" in answer.err) == (0, True)
    assert "twin/p" not in (project.root / "recipes/other/p.yaml").read_text()


def test_what_takes_the_place_of_a_recipe_or_rule_of_dxb_says_so(project):
    for kind, name in (("rule", "factorize.mesh"), ("recipe", "twin/laptop_scene"), ("twin", "twin/box_table")):
        answer = project.dxb("new", kind, name)
        assert (answer.code, f"warning: {name} of this project now takes the place of" in answer.err) == (0, True)
    for kind, name in (("rule", "factorize.mine"), ("recipe", "twin/mine"), ("twin", "twin/mine_too")):
        answer = project.dxb("new", kind, name)
        assert (answer.code, "warning" in answer.err) == (0, False)


def test_a_file_in_place_of_a_folder_is_one_error(project):
    (project.root / "afile").write_text("")
    (project.root / "rules").write_text("")
    for words in (("init", "afile"), ("init", "afile/sub"), ("new", "rule", "a.b")):
        answer = project.dxb(*words)
        assert (answer.code, "error[DXB-U177]" in answer.err) == (2, True), answer.err
