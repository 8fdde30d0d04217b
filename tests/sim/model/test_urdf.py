"""Robots as URDF: MuJoCo, which reads URDF itself, finds the same links in the same places with the same masses."""

from __future__ import annotations

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import Follower, RobotJoint, RobotModel
from dextera_build.formats import urdf_xml
from dextera_build.geometry import poses, quaternions, transforms
from dextera_build.sim.model import links, urdf

ODD = """
<mujoco>
  <compiler angle="radian"/>
  <asset><mesh name="wedge" vertex="0 0 0  0.05 0 0  0 0.05 0  0 0 0.08" inertia="exact"/></asset>
  <worldbody>
    <body name="base" pos="0.3 0 0.1" quat="0.9 0.1 0.3 0.2">
      <geom type="box" size="0.05 0.06 0.02" mass="1" rgba="0.2 0.4 0.6 1"/>
      <body name="shoulder" pos="0 0.1 0.2" quat="0.7 0.1 0.6 0.2">
        <joint name="turn" axis="0 1 1" pos="0.02 0.01 -0.03" range="-2 1"/>
        <joint name="slide" type="slide" axis="1 0 0" pos="0 0.02 0" range="-0.1 0.2" ref="0.05"/>
        <geom type="capsule" size="0.02" fromto="0 0 0  0.1 0.05 0.1" mass="0.5"/>
        <geom type="ellipsoid" size="0.02 0.03 0.05" pos="0.1 0 0" quat="0.8 0.6 0 0" mass="0.3"/>
        <body name="bracket" pos="0.1 0 0.05" quat="0.5 0.5 -0.5 0.5">
          <geom type="sphere" size="0.02" mass="0.2"/>
          <body name="finger" pos="0 0.04 0">
            <joint name="bend" axis="0 0 1" range="-1 2" ref="0.3" damping="0.1" frictionloss="0.02"/>
            <geom type="mesh" mesh="wedge" pos="0.01 0 0" quat="0.6 0 0.8 0" mass="0.1"/>
            <body name="tip" pos="0.05 0 0">
              <joint name="curl" axis="0 1 0" pos="0.005 0 0"/>
              <geom type="cylinder" size="0.01 0.02" mass="0.05"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""Joints off the origin of their body, two in one body, positions that are not 0 where the model was drawn."""


@pytest.fixture(scope="module")
def odd() -> RobotModel:
    limits = {"turn": (-2.0, 1.0), "slide": (-0.1, 0.2), "bend": (-1.0, 2.0)}
    return RobotModel(
        model=Folder(files={"robot.xml": ODD.encode()}),
        joints=tuple(
            RobotJoint(name=name, group="arm", lower=low, upper=high, velocity=3.0, effort=9.0, home=0.0)
            for name, (low, high) in limits.items()
        ),
        links=dict.fromkeys(("base", "shoulder", "bracket", "finger", "tip"), "arm"),
        frames={"flange": "finger"},
        source="hand-made",
        followers=(Follower(name="curl", group="arm", leader="bend", ratio=-0.5, offset=0.1),),
    )


def at(model: mujoco.MjModel, positions: dict[str, float]) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for name, position in positions.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    return data


def place(data: mujoco.MjData, body: str) -> np.ndarray:
    return transforms.rigid(data.body(body).xmat.reshape(3, 3), data.body(body).xpos)


def test_links_are_where_mujoco_has_them(odd: RobotModel) -> None:
    written = urdf.write(odd)
    model = mujoco.MjModel.from_xml_string(ODD)
    again = mujoco.MjModel.from_xml_string(written.files["robot.urdf"].decode(), written.files)
    tree = links.tree(model, "base")
    assert again.njnt == 4
    rng = np.random.default_rng(0)
    for _ in range(5):
        bend = rng.uniform(-1, 2)
        joints = {"turn": rng.uniform(-2, 1), "slide": rng.uniform(-0.1, 0.2), "bend": bend, "curl": 0.1 - 0.5 * bend}
        # MuJoCo's joint position counts from `ref`, and URDF's from 0, where both give the same pose.
        here, there = at(model, joints), at(again, joints)
        chain = {"base": np.eye(4)}
        for edge in tree.edges:
            pose = edge.at(np.array([joints.get(edge.joint, 0.0)]))[0]
            chain[edge.child] = chain[edge.parent] @ poses.to_matrix(pose)
        for body, shift in tree.shifts.items():
            wanted = transforms.invert(place(here, "base")) @ place(here, body)
            wanted[:3, 3] = transforms.apply(wanted, shift)
            np.testing.assert_allclose(chain[body], wanted, atol=1e-12)
            np.testing.assert_allclose(transforms.invert(place(there, "base")) @ place(there, body), wanted, atol=1e-9)
        base = transforms.invert(place(here, "base"))
        centre = transforms.apply(base, here.subtree_com[model.body("base").id])
        there_centre = transforms.apply(transforms.invert(place(there, "base")), there.subtree_com[1])
        np.testing.assert_allclose(there_centre, centre, atol=1e-6)  # links without shape weigh next to nothing


def test_masses_limits_and_couplings_are_told(odd: RobotModel) -> None:
    written = urdf.write(odd)
    model = mujoco.MjModel.from_xml_string(ODD)
    again = mujoco.MjModel.from_xml_string(written.files["robot.urdf"].decode(), written.files)
    for body in ("base", "shoulder", "bracket", "finger", "tip"):
        assert again.body(body).mass[0] == pytest.approx(model.body(body).mass[0])
        np.testing.assert_allclose(np.sort(again.body(body).inertia), np.sort(model.body(body).inertia), rtol=1e-6)
    root = ElementTree.fromstring(written.files["robot.urdf"])
    found = {joint.get("name"): joint for joint in root.iter("joint")}
    limit = found["turn"].find("limit")
    assert limit is not None
    assert limit.attrib == {"lower": "-2.0", "upper": "1.0", "effort": "9.0", "velocity": "3.0"}
    mimic, bend = found["curl"].find("mimic"), found["bend"].find("dynamics")
    assert mimic is not None
    assert bend is not None
    assert mimic.attrib == {"joint": "bend", "multiplier": "-0.5", "offset": "0.1"}
    assert bend.attrib == {"damping": "0.1", "friction": "0.02"}
    assert found["bracket_fixed"].get("type") == "fixed"
    assert sorted(written.files) == ["meshes/geom_2.stl", "meshes/wedge.stl", "robot.urdf"]


@pytest.mark.parametrize("pitch", [0.4, np.pi / 2, -np.pi / 2])
def test_angles_about_fixed_axes_give_the_rotation_back(pitch: float) -> None:
    def about(axis: int, angle: float) -> np.ndarray:
        quaternion = np.zeros(4)
        quaternion[0], quaternion[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
        return quaternions.to_matrix(quaternion)

    rotation = about(2, -2.0) @ about(1, pitch) @ about(0, 0.7)
    roll, tilt, yaw = urdf_xml.fixed_axes(rotation)
    np.testing.assert_allclose(about(2, yaw) @ about(1, tilt) @ about(0, roll), rotation, atol=1e-9)
