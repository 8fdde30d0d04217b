"""The robot of a world other than the twin: its gains, friction, time step and latency, and its model file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.sim.model import compose
from dextera_build.sim.model.compose import ROBOT


@dataclass(frozen=True)
class Machine:
    """Differences of a robot and its clock from the twin's."""

    seed: int
    """Seed of the draws."""
    gain_spread: float
    """Half range of the factors on stiffness and damping of every joint's controller."""
    arm_friction: float
    """Dry friction of an arm joint, as a fraction of its maximum torque."""
    hand_friction: float
    """Dry friction of a hand joint, as a fraction of its maximum torque."""
    skin_spread: float
    """Half range of the factor on the friction of gripping parts."""
    timestep_s: float
    """Step of the simulation [s]."""
    latency_s: float
    """Time from a command to its effect [s]."""


def machine_of(options: Any) -> Machine:
    """The machine described by a rule's options, field by field."""
    return Machine(**{field.name: getattr(options, field.name) for field in fields(Machine)})


def load(model: Folder) -> Any:
    """The `mujoco.MjSpec` of a folder with `scene.xml`.

    Raises:
        RuleError: MuJoCo rejects it.
    """
    try:
        return compose.load(model, "scene.xml")
    except (KeyError, ValueError) as error:
        raise RuleError("MuJoCo does not load the task's model", code="DXB-B211", facts={"MuJoCo": error}) from None


def disturb(spec: Any, robot: RobotModel, machine: Machine) -> None:
    """Set the robot's gains and friction, and the model's time step."""
    random = np.random.default_rng([machine.seed])
    for joint in robot.joints:
        stiff, damped = 1.0 + machine.gain_spread * random.uniform(-1.0, 1.0, 2)
        actuator = spec.actuator(ROBOT + joint.name)
        actuator.gainprm[0] *= stiff
        actuator.biasprm[1] *= stiff
        actuator.biasprm[2] *= damped
        share = machine.arm_friction if joint.group == "arm" else machine.hand_friction
        hinge = spec.joint(ROBOT + joint.name)
        hinge.frictionloss = max(float(hinge.frictionloss), share * joint.effort)
    skin = 1.0 + machine.skin_spread * random.uniform(-1.0, 1.0)
    for geom in spec.geoms:
        if geom.parent.name.startswith(ROBOT) and geom.priority:
            geom.friction[0] *= skin
    spec.option.timestep = machine.timestep_s


def drop_unused(spec: Any) -> set[str]:
    """Delete unused meshes, materials and textures; return their files."""
    meshes = {geom.meshname for geom in spec.geoms}
    materials = {geom.material for geom in spec.geoms} | {site.material for site in spec.sites}
    dropped = set()
    for mesh in list(spec.meshes):
        if mesh.name not in meshes:
            dropped.add(f"{spec.meshdir}/{mesh.file}")
            spec.delete(mesh)
    for material in list(spec.materials):
        if material.name not in materials:
            spec.delete(material)
    textures = {name for material in spec.materials for name in material.textures}
    for texture in list(spec.textures):
        if texture.name not in textures and texture.type != mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            dropped.add(f"{spec.texturedir}/{texture.file}")
            spec.delete(texture)
    return dropped


def finish(spec: Any, positions: Mapping[str, np.ndarray], before: Any, files: Mapping[str, bytes]) -> Folder:
    """Compile the spec, write keyframe `home` and return the folder.

    Args:
        spec: The `mujoco.MjSpec`.
        positions: Joint -> positions in the keyframe [rad or m].
        before: The twin's `mujoco.MjData` at home; its controls are kept.
        files: Files referenced by the spec; `scene.xml` is replaced.

    Raises:
        RuleError: MuJoCo rejects the model.
    """
    for key in list(spec.keys):
        spec.delete(key)
    others = {name: data for name, data in files.items() if name != "scene.xml"}
    try:
        spec.assets = others
        model = spec.compile()
    except ValueError as error:
        raise RuleError("MuJoCo does not load the changed model", code="DXB-B211", facts={"MuJoCo": error}) from None
    data = mujoco.MjData(model)
    for name, position in positions.items():
        data.joint(name).qpos[:] = position
    spec.add_key(name="home", qpos=data.qpos.copy(), ctrl=before.ctrl.copy())
    return Folder(files={"scene.xml": spec.to_xml().encode(), **dict(sorted(others.items()))})
