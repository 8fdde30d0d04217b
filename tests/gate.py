"""A task that needs no skill: an arm of one joint whose peg pushes the flap of a case about the same vertical axis.

Joint target q [rad] turns the flap to about q + 0.1, so a policy that says 0.8 succeeds and one that says 0.2 does not.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, TaskObject, TaskSpec, View, WorldKind
from dextera_build.geometry import quaternions
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from tests import factories

PUSHES, STOPS_SHORT = 0.8, 0.2
"""Joint targets that succeed and fail [rad]."""
WORLD_FROM_BASE = factories.pose(0.05, -0.3, 0.0, yaw=0.4)
"""T_world_base: neither at the origin nor along the axes, so that a forgotten transform shows."""
SCENE = """
<mujoco model="gate">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 0 2"/>
    <geom name="support" type="plane" size="1 1 0.1" rgba="0.6 0.5 0.4 1"/>
    <body name="case" pos="0 0 0.05">
      <freejoint name="case"/>
      <geom type="box" size="0.04 0.04 0.05" mass="8" rgba="0.2 0.3 0.7 1"/>
      <body name="case_flap" pos="0 0 0.065">
        <joint name="case_flap_hinge" axis="0 0 1" range="-2 2" damping="0.05" frictionloss="0.05"/>
        <geom type="box" size="0.1 0.005 0.012" pos="0.1 0 0" mass="0.05" rgba="0.9 0.7 0.1 1"/>
      </body>
    </body>
    {more}
    <body name="robot/base" {place}>
      <geom type="box" size="0.02 0.02 0.15" pos="0 0 0.15" contype="0" conaffinity="0" rgba="0.5 0.5 0.5 1"/>
      <body name="robot/link" pos="{axis} 0.25">
        <joint name="robot/turn" axis="0 0 1" range="-1.5 1.5" damping="1" armature="0.05"/>
        <geom type="capsule" size="0.012" fromto="0 0 0 0.15 0 0" mass="0.5" contype="0" conaffinity="0"/>
        <geom type="capsule" size="0.008" fromto="0.15 0 0 0.15 0 -{peg}" mass="0.2" rgba="0.8 0.2 0.2 1"/>
        <site name="robot/palm" pos="0.15 0 -0.15"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="robot/turn" joint="robot/turn" kp="120" kv="6" ctrlrange="-1.5 1.5" forcerange="-60 60"/>
  </actuator>
  <keyframe><key name="home" qpos="0 0 0.05 1 0 0 0 0 {spare} {home}" ctrl="{home}"/></keyframe>
</mujoco>
"""
BALL = """<body name="ball" pos="0.3 0.3 0.03"><freejoint name="ball"/>
      <geom type="sphere" size="0.03" mass="0.1" rgba="0.2 0.7 0.3 1"/></body>"""


def bundle(kind: WorldKind = "twin", *, peg_m: float = 0.15, yaw_rad: float = 0.1, ball: bool = False) -> TaskBundle:
    """Turn the flap to 0.9 rad.

    Args:
        kind: What the world is.
        peg_m: Length of the peg [m]; one of 0.05 passes over the flap.
        yaw_rad: Half range of the case's turn at resets [rad].
        ball: Whether a ball lies beside the case.
    """
    quaternion = quaternions.from_matrix(WORLD_FROM_BASE[:3, :3])
    axis = np.linalg.inv(WORLD_FROM_BASE) @ [0.0, 0.0, 0.0, 1.0]
    home = -0.6 - 0.4
    xml = SCENE.format(
        peg=peg_m,
        more=BALL if ball else "",
        spare="0.3 0.3 0.03 1 0 0 0" if ball else "",
        place=f'pos="{_row(WORLD_FROM_BASE[:3, 3])}" quat="{_row(quaternion)}"',
        axis=_row(axis[:2]),
        home=home,
    )
    objects = {"case": _object(factories.pose(z=0.05), ("case_flap_hinge",))}
    if ball:
        objects["ball"] = _object(factories.pose(0.3, 0.3, 0.03))
    return TaskBundle(
        model=Folder(files={"scene.xml": xml.encode()}),
        robot=_robot(home),
        base_pose=factories.placed(WORLD_FROM_BASE, "base"),
        task=TaskSpec(
            name="OpenGate",
            object="case",
            goal=ArticulateGoal(joints={"case_flap_hinge": 0.9}, tolerance=0.25),
            hold_s=0.3,
            timeout_s=3.0,
            reset=Reset(position_m=0.005, yaw_rad=yaw_rad, clutter_m=0.02, robot_rad=0.05),
        ),
        objects=objects,
        kind=kind,
    )


def target(goal: float) -> float:
    """The joint target [rad] that turns the flap by about `goal` + 0.1, whatever the base's own turn is."""
    return goal - 0.4


def view() -> View:
    """A camera above that sees all of it."""
    return View(
        camera=factories.camera(64, 48), camera_pose=factories.placed(factories.look_at((0.2, -0.7, 0.7)), "camera")
    )


def _robot(home: float) -> RobotModel:
    joint = RobotJoint(name="turn", group="arm", lower=-1.5, upper=1.5, velocity=2.0, effort=60.0, home=home)
    return RobotModel(
        model=Folder(files={"robot.xml": b'<mujoco model="kuka_leap"/>'}),
        joints=(joint,),
        links={"base": "arm", "link": "arm"},
        frames={"palm": "palm"},
        source="hand-made",
    )


def _object(place: np.ndarray, joints: tuple[str, ...] = ()) -> TaskObject:
    return TaskObject(
        joints=joints,
        pose=factories.placed(place),
        positions=(0.0,) * len(joints),
        mass_scale=(0.9, 1.1),
        friction=0.8,
        friction_sigma=0.05,
        points=factories.box_corners((-0.04, -0.04, -0.05), (0.04, 0.04, 0.05)),
    )


def _row(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
