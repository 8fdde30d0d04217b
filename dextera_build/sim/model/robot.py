"""Robots in MuJoCo: MJCF from a description, masses."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.geometry import transforms
from dextera_build.sim.model import compose

CONTACT_GROUP = 3
"""Group of invisible collision geoms."""
# Stiff enough for followers to lag by well under a degree, and stable at steps of 2 ms.
COUPLING_SOLREF = [0.005, 1.0]
COUPLING_SOLIMP = [0.95, 0.99, 0.001, 0.5, 2.0]


def load(model: Folder) -> Any:
    """The `mujoco.MjSpec` of a robot's folder: `robot.xml` and its meshes."""
    return compose.load(model, "robot.xml")


def mjcf(robot: Any) -> str:
    """MJCF text of a robot description (the options of rule `simulate.robot`).

    Bodies carry explicit inertials, joints position actuators of the same name, frames are sites; link geometry is in
    group 0, or 3 if not drawn, and collides unless disabled. A follower has no actuator: an equality
    constraint of the same name couples it to its leader. Units: metres, radians, kilograms.
    """
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # As in scenes: an explicit integrator makes the strong dampers of light, folded links oscillate.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for name, colour in robot.colours.items():
        spec.add_material(name=name, rgba=[*colour, 1.0], specular=0.35, shininess=0.5)
    bodies: dict[str, Any] = {}
    for chain in robot.chains:
        for mount in chain.mounts:
            parent = bodies[mount.parent] if mount.parent else spec.worldbody
            _add_chain(spec, parent, mount, chain.links, bodies)
    for role, frame in robot.frames.items():
        bodies[frame.link].add_site(name=role, pos=frame.at_m, quat=frame.quaternion, size=[0.005, 0, 0], group=4)
    for one, other in robot.apart:
        spec.add_exclude(bodyname1=one, bodyname2=other)
    spec.compile()
    return str(spec.to_xml())


def _add_chain(spec: Any, parent: Any, mount: Any, links: Any, bodies: dict[str, Any]) -> None:
    body = parent
    for number, link in enumerate(links):
        pose = _pose(link.at_m, link.quaternion)
        if number == 0:
            pose = _pose(mount.at_m, mount.quaternion) @ pose
        body = body.add_body(name=mount.prefix + link.name, pos=pose[:3, 3], quat=_quaternion(pose))
        body.explicitinertial = True
        body.mass = link.mass_kg
        body.ipos, body.iquat, body.inertia = link.centre_m, link.inertia_quaternion, link.inertia_kgm2
        if link.joint is not None:
            _add_joint(spec, body, mount.prefix, link.joint)
        if link.follower is not None:
            _add_follower(spec, body, mount.prefix, link.follower)
        for piece in link.pieces:
            _add_piece(body, piece)
        bodies[mount.prefix + link.name] = body


def _add_joint(spec: Any, body: Any, prefix: str, joint: Any) -> None:
    name = prefix + joint.name
    limits = [joint.lower_rad, joint.upper_rad]
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=joint.axis,
        range=limits,
        limited=True,
        armature=joint.armature_kgm2,
        frictionloss=joint.friction_nm,
    )
    actuator = spec.add_actuator(
        name=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=name,
        ctrlrange=limits,
        ctrllimited=True,
        forcerange=[-joint.effort_nm, joint.effort_nm],
        forcelimited=True,
    )
    actuator.set_to_position(kp=joint.stiffness_nm_rad, kv=joint.damping_nms_rad)


def _add_follower(spec: Any, body: Any, prefix: str, follower: Any) -> None:
    name = prefix + follower.name
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=follower.axis,
        damping=[follower.damping_nms_rad, 0, 0],
        armature=follower.armature_kgm2,
    )
    spec.add_equality(
        name=name,
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=name,
        name2=prefix + follower.leader,
        data=[follower.offset_rad, follower.ratio, *[0.0] * 10],
        solref=COUPLING_SOLREF,
        solimp=COUPLING_SOLIMP,
    )


def _add_piece(body: Any, piece: Any) -> None:
    kinds = {
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
        "box": mujoco.mjtGeom.mjGEOM_BOX,
        "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
        "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    }
    geom = body.add_geom(type=kinds[piece.shape], material=piece.colour)
    if piece.shape in ("capsule", "cylinder"):
        geom.fromto = [*piece.from_m, *piece.to_m]
        geom.size = [piece.radius_m, 0, 0]
    else:
        geom.pos, geom.quat = piece.at_m, piece.quaternion
        geom.size = [piece.radius_m, 0, 0] if piece.shape == "sphere" else piece.half_m
    if not piece.collides:
        geom.contype = geom.conaffinity = 0
    if not piece.drawn:
        geom.group = CONTACT_GROUP
    if piece.friction is not None:
        # The same priority as objects, so MuJoCo uses the larger friction of the two.
        geom.priority = 1
        geom.friction[0] = piece.friction


def mass(text: str) -> float:
    """Total mass of a compiled MJCF text [kg]."""
    return float(mujoco.MjModel.from_xml_string(text).body_mass.sum())


def _pose(place: Any, quaternion: Any) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quaternion, np.float64) / np.linalg.norm(quaternion))
    return transforms.rigid(matrix.reshape(3, 3), np.asarray(place, np.float64))


def _quaternion(pose: np.ndarray) -> np.ndarray:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, pose[:3, :3].flatten())
    return quaternion
