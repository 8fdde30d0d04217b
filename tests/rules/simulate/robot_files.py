"""Small robots as files: a URDF with meshes, mimic and fixed joints, and an MJCF in degrees with defaults."""

from __future__ import annotations

import struct

import numpy as np

from dextera_build.artifacts.base import Folder

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <material name="blue"><color rgba="0.1 0.2 0.8 1"/></material>
  <link name="base_link">
    <visual><geometry><mesh filename="package://arm_description/meshes/cube.stl"/></geometry></visual>
    <collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision>
  </link>
  <link name="upper">
    <inertial>
      <origin xyz="0.01 0 0.1" rpy="0.1 0.2 0.3"/><mass value="2.5"/>
      <inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.021" iyz="0.0005" izz="0.008"/>
    </inertial>
    <visual>
      <origin xyz="0 0 0.1" rpy="0 1.5707963 0"/><geometry><mesh filename="meshes/prism.dae" scale="1 1 2"/></geometry>
      <material name="blue"/>
    </visual>
    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.04" length="0.2"/></geometry></collision>
  </link>
  <link name="fore">
    <inertial><origin xyz="0 0 0.08"/><mass value="1.2"/>
      <inertia ixx="0.004" ixy="0" ixz="0" iyy="0.004" iyz="0" izz="0.001"/></inertial>
    <collision><origin xyz="0 0 0.08"/><geometry><sphere radius="0.03"/></geometry></collision>
  </link>
  <link name="tool0"/>
  <link name="left"><inertial><mass value="0.1"/>
    <inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0001" iyz="0" izz="0.0001"/></inertial></link>
  <link name="right"><inertial><mass value="0.1"/>
    <inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0001" iyz="0" izz="0.0001"/></inertial></link>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/><child link="upper"/><origin xyz="0.02 0.01 0.13" rpy="0.3 -0.2 0.5"/>
    <axis xyz="0 1 1"/><limit lower="-2.1" upper="1.9" effort="80" velocity="2.2"/>
    <dynamics damping="0.7" friction="0.1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0.123456789 0.222222222" rpy="1.1 0 0.7"/>
    <axis xyz="1 0 0"/><limit lower="-1.0" upper="2.5" effort="40" velocity="3.1"/>
  </joint>
  <joint name="tool" type="fixed">
    <parent link="fore"/><child link="tool0"/><origin xyz="0 0 0.17" rpy="0 0 0.785398163"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="tool0"/><child link="left"/><origin xyz="0 0.02 0.05"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.1"/>
  </joint>
  <joint name="grip_other" type="prismatic">
    <parent link="tool0"/><child link="right"/><origin xyz="0 -0.02 0.05"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.04" effort="20" velocity="0.1"/>
    <mimic joint="grip" multiplier="0.9" offset="0.001"/>
  </joint>
</robot>
"""
HAND = """<mujoco model="hand">
  <compiler angle="degree" eulerseq="xyz" meshdir="assets"/>
  <default>
    <joint damping="0.02" armature="0.001"/>
    <default class="finger"><joint axis="0 1 0" range="-20 95" limited="true"/><position kp="2.5" kv="0.05"/></default>
  </default>
  <asset><mesh name="cube" file="cube.stl" scale="0.5 0.5 0.5"/></asset>
  <worldbody>
    <body name="palm" pos="0.3 0 0" euler="0 0 90">
      <inertial pos="0 0 0.02" mass="0.3" diaginertia="0.0002 0.0002 0.0001"/>
      <geom type="mesh" mesh="cube" contype="0" conaffinity="0" euler="10 20 30"/>
      <geom type="box" size="0.04 0.04 0.01"/>
      <site name="grasp" pos="0.01 0.02 0.03" euler="0 45 0"/>
      <body name="one" pos="0.03 0.01 0.04" euler="15 -30 45">
        <joint name="one" class="finger"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.01" mass="0.05"/>
        <frame pos="0.001 0.002 0.003" euler="5 10 15"><body name="two" pos="0 0 0.0512345678">
          <joint name="two" class="finger" range="-10 80"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.03" size="0.008" mass="0.03"/>
          <site name="tip" pos="0 0 0.035"/>
        </body></frame>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="two" joint2="one" polycoef="0.1 0.7 0 0 0"/></equality>
  <actuator><position class="finger" name="drive" joint="one" forcerange="-0.9 0.9" forcelimited="true"/></actuator>
  <keyframe><key name="open" qpos="0.2 0.3"/></keyframe>
</mujoco>
"""
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * [0.05, 0.04, 0.03]
FACES = [
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
]
PRISM = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="pa" count="18">0 0 0 4 0 0 0 3 0 0 0 5 4 0 5 0 3 5</float_array>
      <technique_common><accessor source="#pa" count="6" stride="3"/></technique_common></source>
    <source id="n"><float_array id="na" count="3">0 0 1</float_array></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
      <input semantic="NORMAL" source="#n" offset="1"/>
      <p>0 0 2 0 1 0 3 0 4 0 5 0</p></triangles>
    <polylist count="3"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4 4 4</vcount>
      <p>0 1 4 3 1 2 5 4 2 0 3 5</p></polylist>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s">
    <node><translate>1 2 3</translate><node><matrix>0 -1 0 0 1 0 0 0 0 0 1 0 0 0 0 1</matrix>
      <instance_geometry url="#g"/></node></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""


def cube() -> bytes:
    """A box as binary STL."""
    rows = b"".join(struct.pack("<12fH", *([0.0] * 3), *CORNERS[list(face)].ravel(), 0) for face in FACES)
    return bytes(80) + struct.pack("<I", len(FACES)) + rows


def cube_text() -> bytes:
    """The same as text."""
    lines = ["solid cube"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:g} {:g} {:g}".format(*CORNERS[corner]) for corner in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube"]).encode()


def arm(text: str = ARM, **more: bytes | None) -> Folder:
    """The arm's package, with its URDF in `urdf/`; further files by name, `__` for the slash, None to leave one out."""
    files: dict[str, bytes | None] = {
        "arm_description/urdf/arm.urdf": text.encode(),
        "arm_description/meshes/cube.stl": cube(),
        "arm_description/urdf/meshes/prism.dae": PRISM.encode(),
        **{name.replace("__", "/"): data for name, data in more.items()},
    }
    return Folder(files={name: data for name, data in files.items() if data is not None})


def hand(text: str = HAND) -> Folder:
    """The hand's folder."""
    return Folder(files={"hand.xml": text.encode(), "assets/cube.stl": cube()})


def both() -> Folder:
    """Arm and hand in one folder."""
    files = {f"arm/{name}": data for name, data in arm().files.items()}
    return Folder(files=files | {f"hand/{name}": data for name, data in hand().files.items()})
