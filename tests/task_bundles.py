"""Small tasks with a hand: a gantry with two fingers over a table, a box to lift, a case with a lid, a wall.

Every joint of the gantry is a slide along an axis of its base, so that a test says in metres what the hand does.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, TaskObject, TaskSpec
from dextera_build.geometry import quaternions
from dextera_build.sim.primitives.articulate.primitive import ArticulateGoal
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from tests import factories

WORLD_FROM_BASE = factories.pose(-0.1, 0.2, 0.0, yaw=0.7)
"""T_world_base: neither at the origin nor along the axes, so that a forgotten transform shows."""
JOINTS = ("x", "y", "z", "left", "right")
"""Slides: the palm in its base's axes, the two fingers apart (+) from the middle, 20 mm when they touch the box."""
LIMITS_M = {"x": 0.6, "y": 0.6, "z": 0.4, "left": 0.06, "right": 0.06}
HOME_M = {"x": 0.0, "y": 0.0, "z": 0.0, "left": 0.05, "right": 0.05}
PALM_M = 0.12
"""Height of the palm over the table where slide z is 0 [m]; fingertips are 110 mm below."""
HALF_M = 0.02
"""Half edge of the box [m]."""
BOX_M = (0.3, 0.1)
"""Where the box stands, in the base [m]."""

ROBOT = """
<body name="{p}base" {place}>
  <body name="{p}rail_x">
    <joint name="{p}x" type="slide" axis="1 0 0" range="-0.6 0.6" damping="20"/>
    <geom type="box" size="0.02 0.02 0.02" pos="0 0 0.7" mass="0.5" contype="0" conaffinity="0"/>
    <body name="{p}rail_y">
      <joint name="{p}y" type="slide" axis="0 1 0" range="-0.6 0.6" damping="20"/>
      <geom type="box" size="0.02 0.02 0.02" pos="0 0 0.7" mass="0.5" contype="0" conaffinity="0"/>
      <body name="{p}palm" pos="0 0 {palm}">
        <joint name="{p}z" type="slide" axis="0 0 1" range="-0.11 0.4" damping="20"/>
        <geom type="box" size="0.03 0.08 0.01" mass="0.5"/>
        <site name="{p}palm" quat="0.28 0.96 0 0"/>
        <site name="{p}flange" pos="0 0 0.01"/>
        <body name="{p}finger_left">
          <joint name="{p}left" type="slide" axis="0 1 0" range="0 0.06" damping="5"/>
          <geom type="box" size="0.01 0.005 0.05" pos="0 0.005 -0.06" mass="0.05" friction="1"/>
          <site name="{p}tip_left" pos="0 0.005 -0.11"/>
        </body>
        <body name="{p}finger_right">
          <joint name="{p}right" type="slide" axis="0 -1 0" range="0 0.06" damping="5"/>
          <geom type="box" size="0.01 0.005 0.05" pos="0 -0.005 -0.06" mass="0.05" friction="1"/>
          <site name="{p}tip_right" pos="0 -0.005 -0.11"/>
        </body>
      </body>
    </body>
  </body>
</body>
"""
ACTUATORS = "".join(
    f'<position name="{{p}}{name}" joint="{{p}}{name}" kp="{kp}" kv="{kv}" forcerange="-{force} {force}"/>'
    for name, kp, kv, force in (
        ("x", 2000, 100, 200),
        ("y", 2000, 100, 200),
        ("z", 2000, 100, 200),
        ("left", 400, 10, 10),
        ("right", 400, 10, 10),
    )
)
SCENE = """
<mujoco model="small_task">
  <compiler angle="radian"/>
  <option jacobian="dense" integrator="implicitfast" cone="elliptic" impratio="10"/>
  <worldbody>
    <geom name="static_support" type="box" size="0.8 0.8 0.02" pos="0.1 0.3 -0.02"/>
    <body name="box" pos="{box}" quat="{turn}">
      <freejoint name="box"/>
      <geom type="box" size="0.02 0.02 0.02" mass="0.1" friction="0.8"/>
    </body>
    <body name="case" pos="{case}" quat="{turn}">
      <freejoint name="case"/>
      <geom type="box" size="0.06 0.05 0.01" mass="0.4"/>
      <body name="case_lid" pos="0 0.05 0.012">
        <joint name="case_lid_hinge" axis="-1 0 0" range="0 2" damping="0.02" frictionloss="0.05"/>
        <geom name="case_lid" type="box" size="0.06 0.05 0.003" pos="0 -0.05 0.003" mass="0.05"/>
      </body>
    </body>
    {extra}
    {robot}
  </worldbody>
  <actuator>{actuators}</actuator>
  <keyframe>
    <key name="home" qpos="{box} {turn}  {case} {turn}  1.5  {home}" ctrl="{home}"/>
  </keyframe>
</mujoco>
"""


def robot() -> RobotModel:
    """The gantry alone."""
    xml = f"<mujoco><worldbody>{ROBOT.format(p='', place='', palm=PALM_M)}</worldbody>"
    xml += f"<actuator>{ACTUATORS.format(p='')}</actuator></mujoco>"
    return RobotModel(
        model=Folder(files={"robot.xml": xml.encode()}),
        joints=tuple(_joint(name) for name in JOINTS),
        links={"base": "arm", "rail_x": "arm", "rail_y": "arm", "palm": "hand"},
        frames={role: role for role in ("flange", "palm", "tip_left", "tip_right")},
        source="hand-made",
    )


def lift(
    *, world_from_base: np.ndarray = WORLD_FROM_BASE, extra: str = "", reset: Reset | None = None, height_m: float = 0.1
) -> TaskBundle:
    """Lift the box.

    Args:
        world_from_base: Where the robot stands; everything else stands in its base.
        extra: More MJCF of the world body.
        reset: Start distribution; None: always the same start.
        height_m: How far [m].
    """
    task = TaskSpec(name="LiftBox", object="box", goal=LiftGoal(height_m=height_m), timeout_s=4.0)
    return _bundle(task, world_from_base, extra, reset)


def close(
    *, world_from_base: np.ndarray = WORLD_FROM_BASE, goal: float = 0.0, reset: Reset | None = None, hold_s: float = 0.5
) -> TaskBundle:
    """Bring the case's lid, which stands at 1.5 rad, to `goal` [rad], 0.1 rad more or less."""
    joints = {"case_lid_hinge": goal}
    task = TaskSpec(
        name="CloseCase",
        object="case",
        goal=ArticulateGoal(joints=joints, tolerance=0.1),
        hold_s=hold_s,
        timeout_s=4.0,
    )
    return _bundle(task, world_from_base, "", reset)


def _bundle(task: TaskSpec, world_from_base: np.ndarray, extra: str, reset: Reset | None) -> TaskBundle:
    box, case = (world_from_base @ factories.pose(*place) for place in ((*BOX_M, HALF_M), (0.3, -0.2, 0.01)))
    turn = _row(quaternions.from_matrix(world_from_base[:3, :3]))
    place = f'pos="{_row(world_from_base[:3, 3])}" quat="{turn}"'
    xml = SCENE.format(
        box=_row(box[:3, 3]),
        case=_row(case[:3, 3]),
        turn=turn,
        extra=extra,
        home=_row(np.array(list(HOME_M.values()))),
        robot=ROBOT.format(p="robot/", place=place, palm=PALM_M),
        actuators=ACTUATORS.format(p="robot/"),
    )
    still = Reset(dynamics=0.0)
    return TaskBundle(
        model=Folder(files={"scene.xml": xml.encode()}),
        robot=robot(),
        base_pose=factories.placed(world_from_base, "base"),
        task=task.model_copy(update={"reset": reset or still}),
        objects={"box": _object(box), "case": _object(case, {"case_lid_hinge": 1.5})},
    )


def _joint(name: str) -> RobotJoint:
    hand = name in ("left", "right")
    lower = {"z": -0.11, "left": 0.0, "right": 0.0}.get(name, -LIMITS_M[name])
    return RobotJoint(
        name=name,
        group="hand" if hand else "arm",
        lower=lower,
        upper=LIMITS_M[name],
        velocity=0.6,
        effort=10.0 if hand else 200.0,
        home=HOME_M[name],
    )


def _object(world_from_object: np.ndarray, joints: dict[str, float] | None = None) -> TaskObject:
    return TaskObject(
        joints=tuple(joints or {}),
        pose=factories.placed(world_from_object),
        positions=tuple((joints or {}).values()),
        mass_scale=(0.7, 1.4),
        friction=0.8,
        friction_sigma=0.1,
        points=factories.box_corners((-HALF_M,) * 3, (HALF_M,) * 3),
    )


def _row(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
