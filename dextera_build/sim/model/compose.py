"""Add a robot to a twin: one MJCF in which the robot's names are prefixed with `robot/`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.geometry import quaternions
from dextera_build.sim.model import own_files

ROBOT = "robot/"
"""Prefix of the robot's names in a task's model."""


def with_robot(
    scene: Folder,
    robot: RobotModel,
    world_from_base: np.ndarray,
    *,
    prefix: str = ROBOT,
    keeps_cameras: bool = False,
) -> Folder:
    """The scene with the robot fixed to the world at `world_from_base`, as a new folder.

    Keyframe `home` is extended by the robot's home configuration.

    Args:
        scene: `scene.xml` and its files.
        robot: The embodiment.
        world_from_base: (4, 4) T_world_base.
        prefix: Prefix of the robot's names.
        keeps_cameras: False removes the scene's cameras, because a task does not depend on its observers (see `View`).

    Raises:
        RuleError: MuJoCo rejects the scene, the robot or the combination.
    """
    import mujoco

    try:
        spec = load(scene, "scene.xml")
        arm = load(robot.model, "robot.xml")
    except ValueError as error:
        raise RuleError(
            "MuJoCo does not load the scene or the robot", code="DXB-B211", facts={"MuJoCo": error}
        ) from None
    home, targets = _home(spec)
    for camera in [] if keeps_cameras else list(spec.cameras):
        spec.delete(camera)
    for key in list(spec.keys):
        spec.delete(key)
    frame = spec.worldbody.add_frame(pos=world_from_base[:3, 3], quat=quaternions.from_matrix(world_from_base[:3, :3]))
    frame.attach_body(arm.body("base"), prefix, "")
    # Attaching does not copy the attached spec's files.
    spec.assets = {**spec.assets, **arm.assets}
    # The arm's controller compensates the robot's own weight, not a payload.
    for body in spec.bodies:
        if body.name.startswith(prefix):
            body.gravcomp = 1.0
    try:
        model = spec.compile()
    except ValueError as error:
        raise RuleError("the robot does not fit into the scene", code="DXB-B212", facts={"MuJoCo": error}) from None
    data = mujoco.MjData(model)
    for name, positions in home.items():
        data.joint(name).qpos[:] = positions
    for name, target in robot.followed(robot.home).items():
        data.joint(prefix + name).qpos[0] = target
    targets |= {prefix + name: target for name, target in robot.home.items()}
    for name, target in targets.items():
        data.actuator(name).ctrl[0] = target
    spec.add_key(name="home", qpos=data.qpos.copy(), ctrl=data.ctrl.copy())
    files = {name: data for name, data in scene.files.items() if name != "scene.xml"}
    others = {f"assets/{name}": data for name, data in robot.model.files.items() if name != "robot.xml"}
    return Folder(files={"scene.xml": spec.to_xml().encode(), **files, **others})


def load(model: Folder, main: str) -> Any:
    """The `mujoco.MjSpec` of the file `main` of a folder, with all other files as assets.

    Raises:
        RuleError: It names a file that the folder does not contain.
    """
    import mujoco

    own_files.check(main, model.files)
    files = {name: data for name, data in model.files.items() if name != main}
    return mujoco.MjSpec.from_string(model.files[main].decode(), assets=files)


def _home(spec: Any) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Joint -> positions and actuator -> target in keyframe `home` of a spec, or in its reference configuration."""
    import mujoco

    model = spec.compile()
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    joints = {model.joint(number).name: data.joint(number).qpos.copy() for number in range(model.njnt)}
    return joints, {model.actuator(number).name: float(data.ctrl[number]) for number in range(model.nu)}


def with_base(model: Folder, world_from_base: np.ndarray, *, prefix: str = ROBOT) -> Folder:
    """A model of `with_robot` with the robot's base at another pose; a model without the robot is unchanged.

    Args:
        model: `scene.xml` and its files.
        world_from_base: (4, 4) T_world_base.
        prefix: Prefix of the robot's names.
    """
    root = ET.fromstring(model.files["scene.xml"])
    for parent in list(root.iter()):
        for body in [child for child in parent if (child.tag, child.get("name")) == ("body", f"{prefix}base")]:
            placed = parent if parent.tag == "frame" else body
            placed.set("pos", _numbers(world_from_base[:3, 3]))
            placed.set("quat", _numbers(quaternions.from_matrix(world_from_base[:3, :3])))
    return Folder(files={**model.files, "scene.xml": ET.tostring(root)})


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)
