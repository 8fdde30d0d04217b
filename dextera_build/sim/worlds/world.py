"""A reference world in MuJoCo: objects as textured meshes, the attached robot, lights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import Part, Thing, World
from dextera_build.errors import RuleError, listing
from dextera_build.geometry.shading import corner_normals
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model import tessellate
from dextera_build.sim.render.lighting import light
from dextera_build.sim.render.rendering import Eye
from dextera_build.sim.render.shot import Shot, average

ROBOT = "robot/"
"""Prefix of the robot's names in the compiled model."""

LAMP_RADIUS_RAD = 0.10
"""Angular radius of the shadow-casting lamp [rad]."""
SKY_REACH_M = 0.6
"""Objects beyond this distance do not darken a surface [m]."""
SKY_DEPTH = 0.75
"""Fraction of the ambient light that a surface without visible sky loses."""


@dataclass(frozen=True)
class Stage:
    """A compiled reference world in its single state."""

    model: Any
    data: Any
    label_of_geom: (
        np.ndarray
    )  # (geoms + 1,) int32: object label 1.., 0 for everything else; the last entry is "no geom"
    names: tuple[str, ...]  # name of label 1, 2, ...


def build(world: World, robot: RobotModel | None, change: Callable[[Any], None] | None = None) -> Stage:
    """Compile the world, put the robot at its joint positions and run forward kinematics.

    Args:
        world: The world.
        robot: The robot, if the world needs one.
        change: Called with the robot's spec before it is attached, to add held objects.

    Raises:
        RuleError: The world needs a robot but none was given, or names a joint that the robot lacks.
    """
    spec = mujoco.MjSpec()
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # As in robot models: MuJoCo warns if the two differ, although nothing moves here.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.visual.headlight.ambient[:] = world.ambient
    spec.visual.headlight.diffuse[:] = 0.0
    spec.visual.headlight.specular[:] = 0.0
    spec.visual.quality.shadowsize = 0  # shadows are cast by rays
    spec.stat.extent = 3.0
    spec.stat.center[:] = 0.0
    for lamp in world.lamps:
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=-3.0 * np.array(lamp.direction) / np.linalg.norm(lamp.direction),
            dir=lamp.direction,
            diffuse=[lamp.strength] * 3,
            specular=[0.5 * lamp.strength] * 3,
            castshadow=lamp.shadow,
        )
    owners: list[int] = []
    for name, thing in world.fixtures.items():
        owners += _add_thing(spec, f"fixture/{name}", thing) * [0]
    for label, (name, thing) in enumerate(world.objects.items(), start=1):
        owners += _add_thing(spec, f"object/{name}", thing) * [label]
    joints = _add_robot(spec, world, robot, change)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, position in joints.items():
        data.joint(ROBOT + name).qpos[0] = position
    mujoco.mj_forward(model, data)
    labels = np.zeros(model.ngeom + 1, np.int32)
    labels[: len(owners)] = owners
    return Stage(model, data, labels, tuple(world.objects))


def _add_robot(
    spec: Any, world: World, robot: RobotModel | None, change: Callable[[Any], None] | None
) -> dict[str, float]:
    if world.stand is None:
        return {}
    if robot is None:
        raise RuleError("the world has a place for a robot, but none is given", hint="add input `robot`")
    unknown = sorted(set(world.stand.joints) - set(robot.home))
    if unknown:
        raise RuleError(f"the robot has no joint `{unknown[0]}`", facts={"joints": listing(robot.home, most=30)})
    child = robots.load(robot.model)
    if change is not None:
        change(child)
    half = world.stand.yaw / 2
    frame = spec.worldbody.add_frame(pos=world.stand.position, quat=[np.cos(half), 0, 0, np.sin(half)])
    frame.attach_body(child.body("base"), ROBOT, "")
    return robot.followed(robot.home | world.stand.joints)


def _add_thing(spec: Any, name: str, thing: Thing) -> int:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, thing.pose.matrix[:3, :3].flatten())
    body = spec.worldbody.add_body(name=name, pos=thing.pose.matrix[:3, 3], quat=quaternion)
    for part_name, part in thing.parts.items():
        add_part(spec, body, f"{name}/{part_name}", part)
    return len(thing.parts)


def add_part(spec: Any, body: Any, name: str, part: Part) -> None:
    """Add a textured piece to a body as a geom without collision."""
    mesh = part.mesh
    asset = spec.add_mesh(name=name)
    # MuJoCo ignores `userfacenormal`, so each face has its own corners.
    asset.uservert = mesh.vertices[mesh.faces].flatten()
    asset.userface = np.arange(3 * len(mesh.faces), dtype=np.int32)
    asset.usernormal = corner_normals(mesh.vertices, mesh.faces).flatten()
    # The inertia of thin or open parts must not fail compilation; nothing moves here.
    asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    material = spec.add_material(name=name, specular=part.gloss, shininess=0.5, rgba=[*mesh.colour, 1])
    if mesh.uv is not None and mesh.texture is not None:
        # For textures given as data, MuJoCo's v starts at the upper edge.
        asset.usertexcoord = (mesh.uv.reshape(-1, 2) * [1, -1] + [0, 1]).flatten()
        asset.userfacetexcoord = np.arange(3 * len(mesh.faces), dtype=np.int32)
        pixels = mesh.texture.pixels
        texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, nchannel=3)
        texture.height, texture.width = pixels.shape[:2]
        texture.data = pixels.tobytes()
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        material.rgba[:] = 1.0
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, name=name)
    geom.contype = geom.conaffinity = 0


def photograph(world: World, robot: RobotModel | None, *, supersample: int, soft: bool) -> Shot:
    """Render the world through its camera.

    Args:
        world: The world.
        robot: The robot, if the world needs one.
        supersample: Samples per pixel edge for the colours, averaged in linear light.
        soft: Whether to ray-cast soft shadows; without it there are no shadows.
    """
    stage = build(world, robot)
    with Eye(stage.model, world.camera, world.camera_pose.matrix) as eye:
        depth = eye.depth(stage.data).astype(np.float64)
        geoms = eye.segmentation(stage.data)
    keys = [number for number, lamp in enumerate(world.lamps) if lamp.shadow]
    fine = world.camera.scaled(supersample)
    with Eye(stage.model, fine, world.camera_pose.matrix) as eye:
        colours = average(eye.rgb(stage.data), supersample)
        if soft and keys:
            for key in keys:
                stage.model.light_diffuse[key] = stage.model.light_specular[key] = 0.0
            dim = average(eye.rgb(stage.data), supersample)
            sky, key_light = light(
                tessellate.surfaces(stage.model, stage.data),
                world.camera,
                world.camera_pose.matrix,
                depth,
                np.array(world.lamps[keys[0]].direction),
                radius_rad=LAMP_RADIUS_RAD,
                reach_m=SKY_REACH_M,
            )
            even = (1.0 - SKY_DEPTH + SKY_DEPTH * sky)[..., None]
            colours = np.clip(dim * even + np.clip(colours - dim, 0, 1) * key_light[..., None], 0, 1)
    return Shot(colours, depth, stage.label_of_geom[geoms])
