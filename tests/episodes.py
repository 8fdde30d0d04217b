"""A hand-made task and episodes of it: a three-joint arm, a box that is lifted and a case with a lid.

Everything is arithmetic: no simulator ran, the box rises beside a tip that happens to be near it. Every action follows
from what is observed, so that a policy can learn it.
"""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Segment, Start
from dextera_build.artifacts.tasks.task import TaskBundle, TaskObject, TaskSpec, View
from dextera_build.geometry import poses, quaternions, transforms
from dextera_build.policy.layout import embodiment
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from tests import factories

RATE_HZ = 20.0
WORLD_FROM_BASE = factories.pose(-0.4, 0.1, 0.0, yaw=0.5)
"""T_world_base of the arm: neither at the origin nor along the axes, so that a forgotten transform shows."""
HOME = (0.0, 0.4, 0.9)
"""Joint positions at rest [rad]."""
BOX_HALF_M = (0.02, 0.03, 0.04)
RISE_M = 0.1

ARM = """
<body name="{p}base" {place}>
  <geom type="cylinder" size="0.05 0.05" pos="0 0 0.05" rgba="0.8 0.8 0.8 1"/>
  <body name="{p}link_1" pos="0 0 0.1">
    <joint name="{p}joint_1" axis="0 0 1" range="-2.5 2.5" damping="2" armature="0.05"/>
    <geom type="capsule" size="0.03" fromto="0 0 0.03 0 0 0.1" mass="1" rgba="0.9 0.5 0.1 1"/>
    <body name="{p}link_2" pos="0 0 0.15">
      <joint name="{p}joint_2" axis="0 1 0" range="-1.5 1.5" damping="2" armature="0.05"/>
      <geom type="capsule" size="0.025" fromto="0 0 0.03 0 0 0.22" mass="0.8" rgba="0.8 0.8 0.8 1"/>
      <body name="{p}link_3" pos="0 0 0.25">
        <joint name="{p}joint_3" axis="0 1 0" range="-2.2 2.2" damping="1" armature="0.02"/>
        <geom type="capsule" size="0.02" fromto="0 0 0.03 0 0 0.17" mass="0.4" rgba="0.3 0.3 0.3 1"/>
        <site name="{p}flange" pos="0 0 0.18"/>
        <site name="{p}palm" pos="0 0 0.19"/>
        <site name="{p}tip_left" pos="0 0.015 0.2"/>
        <site name="{p}tip_right" pos="0 -0.015 0.2"/>
      </body>
    </body>
  </body>
</body>
"""
ACTUATORS = "".join(
    f'<position name="{{p}}joint_{number}" joint="{{p}}joint_{number}" kp="200" kv="10"'
    f' ctrlrange="-{limit} {limit}" forcerange="-60 60"/>'
    for number, limit in ((1, 2.5), (2, 1.5), (3, 2.2))
)
SCENE = """
<mujoco model="lift_box">
  <compiler angle="radian"/>
  <option jacobian="dense" integrator="implicitfast"/>
  <worldbody>
    <light pos="0 0 2"/>
    <geom name="support" type="plane" size="1 1 0.1" rgba="0.5 0.4 0.3 1"/>
    <body name="box" pos="0 0 {box_z}">
      <freejoint name="box"/>
      <geom type="box" size="{box}" mass="0.1" rgba="0.8 0.1 0.1 1"/>
    </body>
    <body name="case" pos="0.2 0.15 0.01">
      <freejoint name="case"/>
      <geom type="box" size="0.06 0.05 0.01" mass="0.3" rgba="0.1 0.3 0.8 1"/>
      <body name="case_lid" pos="0 0.05 0.012">
        <joint name="case_lid_hinge" axis="-1 0 0" range="0 2" damping="0.05" frictionloss="0.1"/>
        <geom type="box" size="0.06 0.05 0.003" pos="0 -0.05 0.003" mass="0.05" rgba="0.1 0.6 0.8 1"/>
      </body>
    </body>
    {arm}
  </worldbody>
  <actuator>{actuators}</actuator>
  <keyframe>
    <key name="home" qpos="0 0 {box_z} 1 0 0 0  0.2 0.15 0.01 1 0 0 0  0  {home}" ctrl="{home}"/>
  </keyframe>
</mujoco>
"""


def robot() -> RobotModel:
    """The arm alone; joints `joint_1`.. in order, two fingertips that are fixed to its last link."""
    xml = f"<mujoco><worldbody>{ARM.format(p='', place='')}</worldbody>"
    xml += f"<actuator>{ACTUATORS.format(p='')}</actuator></mujoco>"
    joints = tuple(
        RobotJoint(
            name=f"joint_{number}", group="arm", lower=-limit, upper=limit, velocity=2.0, effort=60.0, home=HOME[index]
        )
        for index, (number, limit) in enumerate(((1, 2.5), (2, 1.5), (3, 2.2)))
    )
    return RobotModel(
        model=Folder(files={"robot.xml": xml.encode()}),
        joints=joints,
        links={"base": "arm", "link_1": "arm", "link_2": "arm", "link_3": "hand"},
        frames={role: role for role in ("flange", "palm", "tip_left", "tip_right")},
        source="hand-made",
    )


def bundle() -> TaskBundle:
    """Lift the box by `RISE_M`. Positions in the model: box (7), case (7), its lid (1), the arm (3)."""
    quaternion = quaternions.from_matrix(WORLD_FROM_BASE[:3, :3])
    place = f'pos="{_row(WORLD_FROM_BASE[:3, 3])}" quat="{_row(quaternion)}"'
    xml = SCENE.format(
        box_z=BOX_HALF_M[2],
        box=_row(np.array(BOX_HALF_M)),
        home=_row(np.array(HOME)),
        arm=ARM.format(p="robot/", place=place),
        actuators=ACTUATORS.format(p="robot/"),
    )
    return TaskBundle(
        model=Folder(files={"scene.xml": xml.encode()}),
        robot=robot(),
        base_pose=factories.placed(WORLD_FROM_BASE, "base"),
        task=TaskSpec(name="LiftBox", object="box", goal=LiftGoal(height_m=RISE_M), timeout_s=4.0),
        objects={
            "box": _object(factories.pose(0.0, 0.0, BOX_HALF_M[2])),
            "case": _object(factories.pose(0.2, 0.15, 0.01), joints=("case_lid_hinge",)),
        },
    )


def view(width: int = 64, height: int = 48) -> View:
    """A camera in front of the table that sees arm and objects."""
    return View(
        camera=factories.camera(width, height),
        camera_pose=factories.placed(factories.look_at((0.1, -0.9, 0.6)), "camera"),
    )


def wide_camera() -> Camera:
    """A camera whose picture is wider than 4:3."""
    return factories.camera(640, 360)


def small(count: int = 3, steps: int = 20, seed: int = 0) -> Episodes:
    """`count` successes of `steps` steps each, and one failure beside them."""
    items = {str(number): episode(steps, seed=1000 * seed + number) for number in range(count)}
    lost = episode(steps, seed=1000 * seed + count).model_copy(update={"success": False, "reason": "box: not lifted"})
    return Episodes(
        items=items,
        failures={str(count): lost},
        attempts=count + 1,
        task="LiftBox",
        embodiment=embodiment(robot()),
        rate_hz=RATE_HZ,
        joint_names=("joint_1", "joint_2", "joint_3"),
        object_names=("box", "case"),
        displacement_names=("case_lid_hinge",),
        tip_names=("tip_left", "tip_right"),
        limb_names=("arm",),
    )


def episode(steps: int = 20, *, seed: int = 0) -> Episode:
    """The arm swings towards the box, which then rises; where the box stands is drawn from `seed`."""
    rng = np.random.default_rng(seed)
    box = factories.pose(*rng.uniform(-0.05, 0.05, 2), BOX_HALF_M[2], yaw=rng.uniform(-1.0, 1.0))
    case = factories.pose(0.2, 0.15, 0.01, yaw=rng.uniform(-0.3, 0.3))
    seen = transforms.invert(WORLD_FROM_BASE) @ box
    goal = np.array([np.arctan2(seen[1, 3], seen[0, 3]), 0.7, 1.3])
    phase = np.linspace(0.0, 1.0, steps)
    reach, rise = _smooth(phase / 0.5), _smooth((phase - 0.5) / 0.5)
    joints = HOME + reach[:, None] * (goal - HOME)
    ahead = np.concatenate([joints[1:], joints[-1:]])
    places = [(factories.pose(z=float(up) * RISE_M) @ box, case) for up in rise]
    return Episode(
        start=_start(seed, box, case),
        origin="operator",
        success=True,
        reason="",
        segments=_segments(steps),
        action=ahead.astype(np.float32),
        executed=(ahead + rng.normal(0.0, 0.002, ahead.shape)).astype(np.float32),
        hand=np.array([[_palm(row)] for row in ahead], np.float32),
        terms={
            "joints": joints.astype(np.float32),
            "objects": np.array([[_seven(place) for place in pair] for pair in places], np.float32),
            "displacement": np.linspace(0.0, 0.3, steps, dtype=np.float32)[:, None],
            "contact": np.stack([rise, -rise, 0.2 * rise], axis=-1)[:, None, :].repeat(2, axis=1).astype(np.float32),
        },
        goal=np.array([RISE_M], np.float32),
    )


def observed(episode: Episode, **terms: np.ndarray) -> Episode:
    """An episode with other values of observed terms."""
    return episode.model_copy(update={"terms": {**episode.terms, **terms}})


def _start(seed: int, box: np.ndarray, case: np.ndarray) -> Start:
    places = [poses.from_matrix(pose) for pose in (box, case)]
    return Start(
        seed=seed,
        qpos=np.concatenate([*places, [0.0], HOME]),
        ctrl=np.array(HOME),
        mass_scale={"box": 1.1, "case": 0.9},
        friction={"box": 0.6, "case": 0.5},
        gain_scale=1.02,
    )


def _segments(steps: int) -> tuple[Segment, ...]:
    half = steps // 2
    return (
        Segment(name="approach", first=0, last=half, frame="box", contact=False),
        Segment(name="lift", first=half, last=steps, frame="box", contact=True),
    )


def _palm(joints: np.ndarray) -> np.ndarray:
    """Pose of the palm in the base (7,), by the arm's kinematics."""
    turn, bend = joints[0], joints[1] + joints[2]
    reach = 0.25 * np.sin(joints[1]) + 0.19 * np.sin(bend)
    height = 0.25 + 0.25 * np.cos(joints[1]) + 0.19 * np.cos(bend)
    about_z = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    about_y = np.array([np.cos(bend / 2), 0.0, np.sin(bend / 2), 0.0])
    place = [reach * np.cos(turn), reach * np.sin(turn), height]
    return np.concatenate([place, quaternions.multiply(about_z, about_y)])


def _seven(world_from_object: np.ndarray) -> np.ndarray:
    """Position and quaternion w x y z in the base."""
    pose = transforms.invert(WORLD_FROM_BASE) @ world_from_object
    return poses.from_matrix(pose)


def _object(world_from_object: np.ndarray, joints: tuple[str, ...] = ()) -> TaskObject:
    corners = factories.box_corners((-0.02, -0.03, -0.04), BOX_HALF_M)
    return TaskObject(
        joints=joints,
        pose=factories.placed(world_from_object),
        positions=(0.0,) * len(joints),
        mass_scale=(0.7, 1.4),
        friction=0.5,
        friction_sigma=0.1,
        points=corners,
    )


def _smooth(phase: np.ndarray) -> np.ndarray:
    clipped = np.clip(phase, 0.0, 1.0)
    return np.asarray(clipped * clipped * (3.0 - 2.0 * clipped))


def _row(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
