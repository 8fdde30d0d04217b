"""A small world with a toy robot that has an arm and a hand, for calibration captures."""

from __future__ import annotations

from functools import cache

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.scenes.world import Lamp, RobotStand, World
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, transforms

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="base">
      <geom type="cylinder" fromto="0 0 0 0 0 0.2" size="0.07" rgba="0.6 0.6 0.65 1"/>
      <body name="upper" pos="0 0 0.2">
        <joint name="turn" axis="0 0 1" range="-2 2"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.25" size="0.06" rgba="0.8 0.8 0.85 1"/>
        <body name="fore" pos="0 0 0.25">
          <joint name="lean" axis="0 1 0" range="-2 2"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.25" size="0.05" rgba="0.7 0.5 0.4 1"/>
          <body name="wrist" pos="0 0 0.25">
            <joint name="roll" axis="0 0 1" range="-3 3"/>
            <geom type="box" size="0.05 0.03 0.03" rgba="0.5 0.5 0.5 1"/>
            <body name="tool" pos="0 0 0.05">
              <joint name="pitch" axis="1 0 0" range="-2 2"/>
              <geom type="cylinder" fromto="0 0 0 0 0 0.03" size="0.035" rgba="0.5 0.5 0.5 1"/>
              <site name="flange" pos="0 0 0.03"/>
              <body name="palm" pos="0 0 0.03">
                <geom type="box" size="0.05 0.025 0.05" pos="0 0 0.05" rgba="0.3 0.3 0.3 1"/>
                <geom type="capsule" fromto="-0.03 0 0.1 -0.05 0 0.18" size="0.012" rgba="0.3 0.3 0.3 1"/>
                <geom type="capsule" fromto="0.03 0 0.1 0.05 0 0.18" size="0.012" rgba="0.3 0.3 0.3 1"/>
                <site name="palm" pos="0 0 0.05"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
LINKS = {"base": "arm", "upper": "arm", "fore": "arm", "wrist": "arm", "tool": "arm", "palm": "hand"}
LIMITS = {"turn": 2.0, "lean": 2.0, "roll": 3.0, "pitch": 2.0}
SMALL = {
    "supersample": 1,
    "reach_deg": 50.0,
    "board": {
        "square_m": 0.05,
        "marker_m": 0.039,
        "origin_m": (-0.0945, -0.05, -0.08),
        "x_axis": (1.0, 0.0, 0.0),
        "y_axis": (0.0, 0.0, -1.0),
    },
}
"""Options for quick captures with the board beside the wrist."""


def robot() -> RobotModel:
    """An arm of four joints with a palm and two fingers."""
    joints = tuple(
        RobotJoint(name=name, group="arm", lower=-limit, upper=limit, velocity=1.0, effort=1.0, home=0.0)
        for name, limit in LIMITS.items()
    )
    files = Folder(files={"robot.xml": MODEL.encode()})
    return RobotModel(
        model=files, joints=joints, links=LINKS, frames={"flange": "flange", "palm": "palm"}, source="hand-made"
    )


@cache
def world() -> World:
    """The robot alone before a camera."""
    eye = cameras.look_at(np.array([0.1, -1.3, 0.7]), np.array([0.0, 0.0, 0.62]))
    return World(
        objects={},
        fixtures={},
        lamps=(Lamp(direction=(0.3, 1.0, -0.6), strength=0.6),),
        ambient=0.4,
        stand=RobotStand(position=(0.02, 0.05, 0.0), yaw=0.3, joints={}),
        camera=Camera(width=640, height=480, fx=610.0, fy=612.0, cx=322.0, cy=236.0),
        camera_pose=Pose(parent="reference", child="camera", matrix=eye),
    )


def truth() -> np.ndarray:
    """T_base_camera (4, 4)."""
    stand = world().stand
    assert stand is not None
    return np.asarray(transforms.invert(stand.pose().matrix) @ world().camera_pose.matrix)
