"""`dxb new robot`: recipes of robots from files that each hold one fault or one trait, which build as written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from dextera_build.cli.project.robot_text import _rounded
from dextera_build.recipe import strict_yaml
from tests.e2e.space import Space
from tests.rules.simulate.robot_files import ARM, arm, hand

TINY = """<link name="tool0"><inertial><mass value="1e-9"/>
  <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>"""


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path / "project")
    made.write("dxb.toml", 'cache = "cache"\n')
    return made


def put(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


def written(space: Space, name: str) -> dict[str, Any]:
    """The node of a recipe."""
    text = (space.root / "recipes" / "robot" / f"{name}.yaml").read_text()
    return strict_yaml.parse(text, name).plain()


@pytest.mark.slow
def test_files_from_elsewhere_are_copied_so_that_every_recipe_can_use_the_robot(space, tmp_path):
    folder = put(
        tmp_path / "elsewhere", {**arm().files, "arm_description/LICENSE": b"MIT", "arm_description/notes.txt": b""}
    )
    answer = space.dxb("new", "robot", str(folder / "arm_description/urdf/arm.urdf"))
    assert answer.code == 0, answer.err
    assert "copied 4 files" in answer.err
    copied = space.root / "robots" / "arm"
    assert {str(each.relative_to(copied)) for each in copied.rglob("*") if each.is_file()} == {
        *("LICENSE", "meshes/cube.stl", "urdf/arm.urdf", "urdf/meshes/prism.dae")
    }
    assert written(space, "arm")["inputs"] == {"files": "robots/arm"}
    space.write(
        "recipes/task/uses.yaml",
        "summary: s\ninputs: {robot: robot/arm:robot}\nnodes:\n  again: $robot\ntargets: {default: [again]}\n",
    )
    built = space.dxb("build", "robot/arm", "--console", "plain")
    assert built.code == 0, built.err
    assert "tasks: dxb new task twin/laptop_scene robot/arm" in built.err


def test_guesses_are_said_with_their_confidence(space):
    put(space.root / "robots", dict(arm().files))
    answer = space.dxb("new", "robot", "robots/arm_description/urdf/arm.urdf")
    assert "flange = tool0: certain, its name" in answer.err
    assert "gripper of arm = grip: open at 0.04, closed at 0" in answer.err
    assert re.search(
        r"palm: \{link: tool0, .*# likely: two fingers", (space.root / "recipes/robot/arm.yaml").read_text()
    )


def test_a_hand_that_is_drawn_only_is_solid(space):
    drawn = '<visual><geometry><box size="0.02 0.01 0.06"/></geometry></visual>'
    text = ARM.replace('<link name="left">', f'<link name="left">{drawn}')
    put(space.root / "robots", dict(arm(text).files))
    answer = space.dxb("new", "robot", "robots/arm_description/urdf/arm.urdf")
    assert "no collision shapes, so that what is drawn touches: left" in answer.err
    (part,) = written(space, "arm")["nodes"]["robot"]["parts"]
    assert part["solid"] == ["left"]


@pytest.mark.slow
def test_impossible_inertias_are_repaired_on_request_and_said(space):
    text = ARM.replace('<link name="tool0"/>', TINY).replace('izz="0.001"', 'izz="0.1"')
    put(space.root, dict(arm(text).files))
    refused = space.dxb("new", "robot", "arm_description/urdf/arm.urdf")
    assert refused.code != 0
    assert "link `fore` has principal moments" in refused.err
    assert "tool0" in refused.err
    assert "--repair-inertias" in refused.err
    answer = space.dxb("new", "robot", "arm_description/urdf/arm.urdf", "--repair-inertias")
    assert answer.code == 0, answer.err
    assert "repaired inertia of `fore`: 0.004 0.004 0.1 -> 0.05 0.05 0.1 kg m^2" in answer.err
    assert "repaired inertia of `tool0`: 0 0 0 -> 4e-16 4e-16 4e-16 kg m^2" in answer.err
    built = space.dxb("build", "robot/arm", "--console", "plain")
    assert built.code == 0, built.err
    assert "link `fore`: moments of inertia" in built.err


@pytest.mark.medium
def test_a_home_at_a_limit_is_inside_it(space):
    text = ARM.replace('lower="-1.0" upper="2.5"', 'lower="0.820304748437" upper="0.820355"')
    put(space.root, dict(arm(text).files))
    assert space.dxb("new", "robot", "arm_description/urdf/arm.urdf").code == 0
    elbow = float(written(space, "arm")["nodes"]["robot"]["home_rad"]["elbow"])
    assert 0.820304748437 <= elbow <= 0.820355
    assert space.dxb("build", "robot/arm", "--console", "none").code == 0


@pytest.mark.parametrize(
    ("value", "low", "high", "wanted"),
    [
        (0.82030, 0.820304748437, 2.0, "0.8204"),
        (3.14159265, -3.14159265, 3.14159265, "3.1415"),
        (-3.14159265, -3.14159265, 3.14159265, "-3.1415"),
        (0.5, 0.00001, 0.00002, "2e-05"),
        (0.25, 0.0, 1.0, "0.25"),
    ],
)
def test_positions_are_rounded_inwards(value, low, high, wanted):
    assert _rounded(value, low, high) == wanted


@pytest.mark.medium
def test_a_recipe_that_hides_one_of_dxbs_is_said(space):
    put(space.root / "robots", {name.replace("arm.urdf", "panda.urdf"): data for name, data in arm().files.items()})
    answer = space.dxb("new", "robot", "robots/arm_description/urdf/panda.urdf")
    assert "takes the place of dxb's recipe of the same name" in answer.err
    other = space.dxb("new", "robot", "robots/arm_description/urdf/panda.urdf", "-o", "recipes/robot/my_panda.yaml")
    assert other.code == 0
    assert "takes the place" not in other.err
    assert "dxb build robot/my_panda, dxb view robot/my_panda" in other.err


def test_two_robots_in_files_of_one_name_keep_their_own_files(space, tmp_path):
    for name, joint in (("jaco", "elbow"), ("baxter", "bend")):
        put(tmp_path / name, dict(arm(ARM.replace("elbow", joint)).files))
        (tmp_path / name / "arm_description/urdf/arm.urdf").rename(tmp_path / name / "arm_description/urdf/robot.urdf")
    files = {name: str(tmp_path / name / "arm_description/urdf/robot.urdf") for name in ("jaco", "baxter")}
    for name, joint in (("jaco", "elbow"), ("baxter", "bend")):
        answer = space.dxb("new", "robot", files[name], "-o", f"recipes/robot/{name}.yaml")
        assert answer.code == 0, answer.err
        assert f"dxb build robot/{name}, dxb view robot/{name}" in answer.err
        made = written(space, name)
        assert (made["inputs"]["files"], made["nodes"]["robot"]["name"]) == (f"robots/{name}", name)
        assert joint in (space.root / "robots" / name / "urdf/robot.urdf").read_text()
    (space.root / "recipes/robot/jaco.yaml").unlink()
    before = (space.root / "robots/jaco/urdf/robot.urdf").read_bytes()
    refused = space.dxb("new", "robot", files["baxter"], "-o", "recipes/robot/jaco.yaml")
    assert (refused.code, "error[DXB-U191]" in refused.err) == (2, True), refused.err
    assert "robots/jaco/urdf/robot.urdf" in refused.err
    assert not (space.root / "recipes/robot/jaco.yaml").exists()
    assert (space.root / "robots/jaco/urdf/robot.urdf").read_bytes() == before
    assert space.dxb("new", "robot", files["jaco"], "-o", "recipes/robot/jaco.yaml").code == 0  # the same bytes


def test_a_file_without_a_joint_is_no_robot(space):
    space.write("tool.xml", '<mujoco><worldbody><body name="tool"><geom size=".1"/></body></worldbody></mujoco>')
    answer = space.dxb("new", "robot", "tool.xml")
    assert answer.code == 2
    assert "error[DXB-U217]: `tool.xml` has no joint" in answer.err
    assert not (space.root / "recipes").exists()


def test_a_recipe_outside_of_recipes_is_told_its_place(space):
    put(space.root / "robots", dict(arm().files))
    answer = space.dxb("new", "robot", "robots/arm_description/urdf/arm.urdf", "-o", "mine.yaml")
    assert answer.code == 0, answer.err
    assert "move it to recipes/robot/mine.yaml, check every marked guess, then: dxb build robot/mine" in answer.err
    (space.root / "recipes/robot").mkdir(parents=True)
    (space.root / "mine.yaml").rename(space.root / "recipes/robot/mine.yaml")
    assert space.dxb("plan", "robot/mine").code == 0


@pytest.mark.slow
def test_an_arm_and_a_hand_of_two_files_become_one_robot(space, tmp_path):
    bare = re.sub(r'<joint name="grip.*?</joint>', "", ARM, flags=re.DOTALL)
    bare = re.sub(r'<link name="(left|right)">.*?</link>', "", bare, flags=re.DOTALL)
    put(tmp_path / "arm", dict(arm(bare).files))
    put(tmp_path / "hand", dict(hand().files))
    answer = space.dxb(
        "new", "robot", str(tmp_path / "arm/arm_description/urdf/arm.urdf"), str(tmp_path / "hand/hand.xml")
    )
    assert (answer.code, answer.out) == (0, "recipes/robot/arm_with_hand.yaml\n"), answer.err
    node = written(space, "arm_with_hand")["nodes"]["robot"]
    assert node["attach"]["hand"] == "hand/hand.xml"
    assert node["attach"]["at"] == "flange"
    assert node["frames"]["flange"]["link"] == "tool0"
    assert f"palm = {node['frames']['palm']['link']}: " in answer.err
    built = space.dxb("build", "robot/arm_with_hand", "--console", "plain")
    assert built.code == 0, built.err
    assert "3 joints (1 of the hand)" in built.err
