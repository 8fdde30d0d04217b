"""Parts of MJCF files on the drives of a robot, with a pendulum whose bob is a mesh."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.errors import RuleError
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model.robot_meshes import Part, dressed, misplaced

ROBOT = """
<mujoco model="pendulum">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/>
      <geom size="0.1"/>
      <body name="bob" pos="0 0 0.5">
        <inertial pos="0 0 -0.1" mass="1" diaginertia="0.1 0.1 0.1"/>
        <joint name="hinge" axis="0 1 0" range="-1 1" limited="true" armature="0.02"/>
        <geom size="0.05"/>
        <site name="tip" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="base" body2="bob"/></contact>
  <actuator><position name="hinge" joint="hinge" kp="20" kv="1" ctrlrange="-1 1" forcerange="-5 5"/></actuator>
</mujoco>
"""
FILE = """
<mujoco model="published">
  <compiler angle="radian" meshdir="shapes"/>
  <default>
    <joint damping="9"/>
    <default class="look"><geom contype="0" conaffinity="0" rgba="1 0 0 1"/></default>
  </default>
  <asset>
    <material name="blue" rgba="0 0 1 1"/>
    <mesh name="wedge" file="wedge.obj"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="foot" pos="5 5 5">
      <geom type="mesh" mesh="wedge" density="7000"/>
      <body name="bob" pos="0 0 0.5" euler="0 0.3 0">
        <inertial pos="0 0 -0.2" mass="2" diaginertia="0.2 0.2 0.2"/>
        <joint name="hinge" axis="0 1 0" range="-1 1" limited="true"/>
        <geom class="look" type="mesh" mesh="wedge" material="blue" pos="0 0 0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03"/>
        <body name="mark" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""
WEDGE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def pendulum() -> RobotModel:
    return RobotModel(
        model=Folder(files={"robot.xml": ROBOT.encode()}),
        joints=(RobotJoint(name="hinge", group="arm", lower=-1, upper=1, velocity=1, effort=5, home=0.2),),
        links={"base": "arm", "bob": "arm"},
        frames={"tip": "tip"},
        source="made up",
    )


@pytest.fixture
def part(tmp_path: Path) -> Part:
    return written(tmp_path, FILE)


def written(folder: Path, text: str) -> Part:
    """The part `foot` of a MJCF in `folder`."""
    (folder / "shapes").mkdir(exist_ok=True)
    (folder / "shapes" / "wedge.obj").write_text(WEDGE)
    (folder / "published.xml").write_text(text.replace('euler="0 0.3 0"', 'quat="0.98877 0 0.14944 0"'))
    return Part(folder / "published.xml", "foot", "new_", {"foot": "base"})


def test_geometry_and_masses_come_from_the_file_and_drives_from_the_model(pendulum: RobotModel, part: Part) -> None:
    folder = dressed(pendulum, [part])
    assert sorted(folder.files) == ["meshes/new_wedge.obj", "robot.xml"]
    model = robots.load(folder).compile()
    assert (model.nbody, model.nu, model.nmesh, model.nsite, model.nexclude, model.nlight) == (3, 1, 1, 1, 1, 0)
    assert model.body("bob").mass == 2
    assert model.body("base").mass == 3  # the file states none
    np.testing.assert_array_equal(model.body("base").pos, 0)
    assert model.actuator("hinge").gainprm[0] == 20
    assert model.actuator("hinge").forcerange[1] == 5
    assert model.dof_armature[0] == 0.02
    assert model.dof_damping[0] == 0
    assert misplaced(part, folder) < 1e-6


def test_only_what_does_not_touch_is_drawn(pendulum: RobotModel, part: Part) -> None:
    model = robots.load(dressed(pendulum, [part])).compile()
    assert model.geom_group.tolist() == [3, 2, 3]
    assert model.geom_contype.tolist() == [1, 0, 1]
    np.testing.assert_allclose(model.geom_rgba[1], [0, 0, 1, 1])
    shown = dataclasses.replace(part, drawn=("wedge",))
    assert robots.load(dressed(pendulum, [shown])).compile().geom_group.tolist() == [0, 2, 3]


def test_geometry_in_another_place_is_noticed(pendulum: RobotModel, part: Part) -> None:
    folder = dressed(pendulum, [part])
    moved = folder.files["robot.xml"].replace(b'pos="0 0 0.1"', b'pos="0 0 0.12"')
    assert moved != folder.files["robot.xml"]
    shift = 0.02 * np.cos(0.3)  # the bob leans by 0.3 rad
    assert misplaced(part, Folder(files={**folder.files, "robot.xml": moved})) == pytest.approx(shift, abs=1e-4)


def test_a_rotation_that_is_not_a_quaternion_is_noticed(pendulum: RobotModel, tmp_path: Path) -> None:
    """MuJoCo keeps an `euler` apart from the quaternion that is taken over."""
    part = written(tmp_path, FILE.replace('pos="0 0 0.1"', 'pos="0 0 0.1" euler="0 0 1"'))
    assert misplaced(part, dressed(pendulum, [part])) > 0.1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</mujoco>", "", "`published.xml` does not load"),
        ('name="foot"', 'name="feet"', "`published.xml` has no body `foot`"),
        ('name="bob"', 'name="ball"', "`published.xml` has a body `ball`, but no link is called so"),
        ('name="hinge"', 'name="pivot"', "no part has the joint `hinge`"),
        ('range="-1 1"', 'range="-1 2"', "the limits of joint `hinge` differ from those of the model"),
    ],
)
def test_files_that_do_not_fit_are_refused(
    pendulum: RobotModel, tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = FILE.replace('<actuator><motor joint="hinge"/></actuator>', "").replace(old, new)
    with pytest.raises(RuleError) as error:
        dressed(pendulum, [written(tmp_path, text)])
    assert message in error.value.message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"renamed": {}}, "no link is called `foot`"),
        ({"root": "bob"}, "`bob` is attached to `base`, which no part before it has"),
    ],
)
def test_parts_that_do_not_fit_are_refused(
    pendulum: RobotModel, part: Part, change: dict[str, object], message: str
) -> None:
    with pytest.raises(RuleError) as error:
        dressed(pendulum, [dataclasses.replace(part, **change)])  # type: ignore[arg-type]
    assert message in error.value.message


def test_every_link_must_come_from_a_part(pendulum: RobotModel, part: Part) -> None:
    more = pendulum.model_copy(update={"links": {**pendulum.links, "hand": "hand"}})
    with pytest.raises(RuleError, match="no part has the link `hand`"):
        dressed(more, [part])


def test_shapes_that_mujoco_refuses_are_one_error(pendulum: RobotModel, part: Part) -> None:
    (part.file.parent / "shapes" / "wedge.obj").write_text("v 0 0 0\n")
    with pytest.raises(RuleError, match="the parts do not fit together"):
        dressed(pendulum, [part])
