"""A small reference world, and a hand-made twin of it with known errors, as a task for a robot with one joint."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.robot import RobotJoint, RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.artifacts.tasks.task import TaskBundle, TaskObject, TaskSpec
from dextera_build.geometry import kinematics, metrics, transforms
from dextera_build.sim.model import compose
from dextera_build.sim.model.model import at_home, compile_folder
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from tests import factories, twins
from tests.rules.capture.cameras import CAMERA

TWIN_FROM_TRUTH = factories.pose(0.05, -0.03, 0.0, 0.2)
"""Where the true world's frame lies in the twin's (4, 4)."""
STAND: dict[str, Any] = {"position_m": (0.45, 0.30, 0.0), "yaw_deg": 190.0}
"""The robot's place in the true world."""
WORLD: dict[str, Any] = {
    "camera": CAMERA,
    "objects": {
        "laptop": {"kind": "laptop", "at_m": (-0.22, 0.1), "yaw_deg": 10.0, "opening_deg": 108.0},
        "mug": {"kind": "mug", "at_m": (0.12, -0.1)},
        "carton": {"kind": "carton", "at_m": (0.3, 0.05), "size_m": (0.06, 0.16, 0.21), "mass_kg": 0.5},
    },
    "lamps": ({"direction": (0.3, 0.5, -1.0), "strength": 0.6, "shadow": True},),
    "robot": STAND,
}
"""Options of `reference.world`."""
ROBOT = """
<mujoco>
  <worldbody>
    <body name="base">
      <geom type="cylinder" size="0.05 0.02" pos="0 0 0.02"/>
      <body name="link" pos="0 0 0.1">
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
        <joint name="turn" axis="0 0 1" range="-1 1" limited="true"/>
        <geom type="capsule" fromto="0 0 0.3 0.2 0 0.3" size="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="turn" joint="turn" kp="100" kv="10" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
"""A robot that can turn its one arm."""


def robot() -> RobotModel:
    """The robot of one joint."""
    joint = RobotJoint(name="turn", group="arm", lower=-1.0, upper=1.0, velocity=1.0, effort=20.0, home=0.3)
    return RobotModel(
        model=Folder(files={"robot.xml": ROBOT.encode()}),
        joints=(joint,),
        links={"base": "arm", "link": "arm"},
        frames={},
        source="hand-made",
    )


def assets(world: World, **changed: Asset) -> dict[str, Asset]:
    """Assets of the three things, millimetres and hundredths of a radian off; a cup of the wrong shape for the mug."""
    place = {name: TWIN_FROM_TRUTH @ thing.pose.matrix for name, thing in world.objects.items()}
    return {
        "red_box": factories.box_asset(place["carton"] @ factories.pose(0.001, -0.001, 0.0, 0.02)),
        "cup": factories.bowl_asset(place["mug"] @ factories.pose(0.002, 0.001), radius=0.041, height=0.09),
        "notebook": factories.laptop_asset(place["laptop"] @ factories.pose(-0.002, 0.001, 0.0, -0.01), opening=1.9),
        **changed,
    }


def bundle(placed: dict[str, Asset], moved: np.ndarray | None = None) -> TaskBundle:
    """The task of a twin that holds `placed`; `moved` (4, 4) disturbs where it believes the robot to be."""
    x, y, z = STAND["position_m"]
    true_base = factories.pose(x, y, z, float(np.radians(STAND["yaw_deg"])))
    base = (np.eye(4) if moved is None else moved) @ TWIN_FROM_TRUTH @ true_base
    scene = twins.scene(placed, factories.background(half=0.7))
    return TaskBundle(
        model=compose.with_robot(scene, robot(), base),
        robot=robot(),
        base_pose=factories.placed(base, "base"),
        task=TaskSpec(name="Test", object="red_box", goal=LiftGoal(height_m=0.1)),
        objects={name: _object(name, asset) for name, asset in sorted(placed.items())},
    )


def _object(name: str, asset: Asset) -> TaskObject:
    vertices, faces = kinematics.posed_surface(asset.body)
    return TaskObject(
        joints=tuple(f"{name}_{joint.child}_{joint.name}" for joint in asset.body.joints),
        pose=asset.pose,
        positions=tuple(joint.position for joint in asset.body.joints),
        mass_scale=(0.7, 1.4),
        friction=asset.physics.friction,
        friction_sigma=asset.physics.friction_sigma,
        points=metrics.sample_surface(vertices, faces, 256, seed=0).astype(np.float32),
    )


def opened(task: TaskBundle) -> tuple[Any, Any]:
    """The compiled model of a task, and its data at keyframe `home`."""
    model = compile_folder(task.model)
    return model, at_home(model)


def pose_of(data: Any, body: str) -> np.ndarray:
    """T_world_body (4, 4) of a state."""
    return transforms.rigid(data.body(body).xmat.reshape(3, 3).copy(), data.body(body).xpos.copy())


def corners_of(model: Any, data: Any, geom: str) -> np.ndarray:
    """World positions (V, 3) [m] of the vertices of a mesh geom."""
    number = model.geom(geom).id
    mesh = int(model.geom_dataid[number])
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    local = model.mesh_vert[first : first + count].astype(np.float64)
    return np.asarray(local @ data.geom_xmat[number].reshape(3, 3).T + data.geom_xpos[number])


def dropped_ball(task: TaskBundle, place: np.ndarray, radius: float) -> np.ndarray:
    """Where a ball of `radius` [m] comes to rest that is let go at `place` (3,) [m] in the task's world."""
    files = {name: data for name, data in task.model.files.items() if name != "scene.xml"}
    spec = mujoco.MjSpec.from_string(task.model.files["scene.xml"].decode(), assets=files)
    home = at_home(compile_folder(task.model))
    for key in list(spec.keys):
        spec.delete(key)
    ball = spec.worldbody.add_body(name="ball", pos=place)
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=0.005)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[: home.qpos.size], data.ctrl[:] = home.qpos, home.ctrl
    mujoco.mj_step(model, data, round(1.5 / model.opt.timestep))
    return np.asarray(data.body("ball").xpos.copy())
