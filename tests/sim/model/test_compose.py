"""A robot put into a scene: its names, its place, its home, and what a task's model leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model.compose import with_robot
from dextera_build.sim.model.model import at_home, compile_folder
from tests import factories, task_bundles

PLACE = factories.pose(0.3, -0.2, 0.05, yaw=0.8)
SCENE = """<mujoco><worldbody>
  <camera name="eye" pos="0 0 1"/>
  <geom name="static_support" type="plane" size="1 1 .1"/>
  <body name="box" pos="0 0 .02"><freejoint name="box"/><geom type="box" size=".02 .02 .02" mass=".1"/></body>
</worldbody><keyframe><key name="home" qpos=".1 .2 .02 1 0 0 0"/></keyframe></mujoco>"""


def scene(xml: str = SCENE) -> Folder:
    return Folder(files={"scene.xml": xml.encode(), "assets/picture.png": b"kept as it is"})


def test_the_robot_stands_where_it_is_put_and_bears_its_prefix():
    made = with_robot(scene(), task_bundles.robot(), PLACE)
    model = compile_folder(made)
    data = at_home(model)
    base = data.body("robot/base")
    assert np.allclose(base.xpos, PLACE[:3, 3])
    assert np.allclose(base.xmat.reshape(3, 3), PLACE[:3, :3])
    names = {model.joint(number).name for number in range(model.njnt)}
    assert names == {"box", *(f"robot/{name}" for name in task_bundles.JOINTS)}
    assert [model.actuator(number).name for number in range(model.nu)] == [
        f"robot/{name}" for name in task_bundles.JOINTS
    ]
    assert made.files["assets/picture.png"] == b"kept as it is"


def test_home_is_that_of_the_scene_and_of_the_robot():
    data = at_home(compile_folder(with_robot(scene(), task_bundles.robot(), PLACE)))
    assert np.allclose(data.joint("box").qpos, [0.1, 0.2, 0.02, 1, 0, 0, 0])
    for name, position in task_bundles.HOME_M.items():
        assert data.joint(f"robot/{name}").qpos[0] == position
        assert data.actuator(f"robot/{name}").ctrl[0] == position


def test_no_camera_is_left_so_that_a_task_does_not_depend_on_who_looks_on():
    moved = SCENE.replace('pos="0 0 1"', 'pos="0.02 0 1"')
    made = with_robot(scene(), task_bundles.robot(), PLACE)
    assert compile_folder(made).ncam == 0
    assert with_robot(scene(moved), task_bundles.robot(), PLACE) == made


def test_the_scene_and_the_robot_are_not_changed():
    folder, robot = scene(), task_bundles.robot()
    before = folder.model_dump(), robot.model.model_dump()
    with_robot(folder, robot, PLACE)
    assert (folder.model_dump(), robot.model.model_dump()) == before


def test_a_scene_that_does_not_load_says_so():
    with pytest.raises(RuleError, match="MuJoCo does not load the scene or the robot") as caught:
        with_robot(scene("<mujoco><worldbody><nonsense/></worldbody></mujoco>"), task_bundles.robot(), PLACE)
    assert caught.value.code == "DXB-B211"
    assert "nonsense" in str(caught.value.facts["MuJoCo"])


def test_a_scene_that_has_the_robot_s_names_already_says_so():
    taken = SCENE.replace('body name="box"', 'body name="robot/palm"')
    with pytest.raises(RuleError) as caught:
        with_robot(scene(taken), task_bundles.robot(), PLACE)
    assert caught.value.code in ("DXB-B211", "DXB-B212")
