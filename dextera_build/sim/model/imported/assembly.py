"""A robot model assembled from descriptions: bodies of the files, with drives, frames and names of the options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.errors import RuleError
from dextera_build.sim.model import robot as robots
from dextera_build.sim.model.fixed_joints import fix
from dextera_build.sim.model.imported.precise import precise
from dextera_build.sim.model.imported.source import Source
from dextera_build.sim.model.robot_meshes import COLLISION, SEEN, VISUAL

STIFFNESS = 12.0
"""Stiffness of a joint if the file states none: its maximum torque is reached 1/12 rad from the target [1/rad]."""
OUT_M = 0.003
"""Minimum distance by which collision geometry must protrude from visual geometry to be drawn [m]."""
DAMPING = 0.1
"""Damping of a joint if the file states none, per stiffness [s]."""


@dataclass(frozen=True)
class Placed:
    """A description and the pose of its root.

    Args:
        source: The description.
        root: Body whose subtree is used.
        prefix: Prefix of its names.
        parent: Link that it is mounted on, with prefix; empty for the world.
        place: T_parent_root, position [m].
        turn: The same, quaternion w x y z.
        drawn: Collision meshes that are also visible, although their links have separate visual meshes.
    """

    source: Source
    root: str
    prefix: str = ""
    parent: str = ""
    place: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
    drawn: Sequence[str] = ()


@dataclass(frozen=True)
class Drive:
    """A joint of the model; all values in rad, N m or m, N.

    Args:
        name: Name with prefix.
        lower: Lower limit.
        upper: Upper limit.
        effort: Largest torque or force.
        stiffness: Stiffness of its position actuator.
        damping: Damping of its position actuator.
    """

    name: str
    lower: float
    upper: float
    effort: float
    stiffness: float
    damping: float


@dataclass
class Frame:
    """A named frame: link, position [m], quaternion w x y z."""

    link: str
    place: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0)


@dataclass
class Plan:
    """Everything that is not in the files.

    Args:
        drives: Actuated joints, in order.
        followers: Joint -> leader, ratio and offset.
        fixed: Joint -> position at which it is fixed.
        frames: Role -> frame.
        apart: Pairs of links excluded from contact.
        home: Joint -> position, at which links in contact are found.
        drawn: Collision meshes that are visible.
    """

    drives: list[Drive]
    followers: dict[str, tuple[str, float, float]]
    fixed: dict[str, float]
    frames: dict[str, Frame]
    apart: list[tuple[str, str]]
    home: dict[str, float] = field(default_factory=dict)
    drawn: set[str] = field(default_factory=set)


def attached(parts: Sequence[Placed], name: str) -> Any:
    """The `mujoco.MjSpec` of all bodies, without drives; the root of the first is `base`."""
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assets: dict[str, bytes] = {}
    for number, part in enumerate(parts):
        source = part.source.spec
        _strip(source)
        files = {f"{number}_{file}": data for file, data in source.assets.items()}
        for each in [*source.meshes, *source.textures]:
            if each.file:
                each.file = f"{number}_{each.file}"
        for each in source.textures:
            each.cubefiles = [file and f"{number}_{file}" for file in each.cubefiles]
        root = source.body(part.root)
        root.pos, root.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
        root.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        parent = spec.worldbody if not part.parent else spec.body(part.parent)
        # MuJoCo needs a prefix to distinguish classes and meshes; names of links and joints are those of the file.
        own = own_prefix(number)
        parent.add_frame(pos=part.place, quat=part.turn).attach_body(root, own, "")
        assets |= files
        for each in [*spec.bodies, *spec.joints]:
            if each.name.startswith(own):
                each.name = part.prefix + each.name.removeprefix(own)
        if number == 0:
            spec.body(part.prefix + part.root).name = "base"
    spec.assets = assets
    return spec


def own_prefix(number: int) -> str:
    """Prefix of the meshes and materials of a part."""
    return f"part{number}_"


def _strip(spec: Any) -> None:
    """Remove elements that a robot model defines itself or must not have."""
    for kind in ("sensors", "actuators", "keys", "tendons", "equalities", "excludes", "pairs", "skins", "cameras"):
        for each in list(getattr(spec, kind)):
            spec.delete(each)
    for each in [*spec.lights, *spec.sites]:
        spec.delete(each)


def finished(spec: Any, plan: Plan) -> tuple[Folder, list[tuple[str, str]]]:
    """Add drives and frames; return the folder and the pairs of links in contact at home, which no longer collide.

    Raises:
        RuleError: MuJoCo rejects the model.
    """
    for name, position in plan.fixed.items():
        fix(spec, name, position)
    for drive in plan.drives:
        _add_drive(spec, drive)
    for name, (leader, ratio, offset) in plan.followers.items():
        spec.joint(name).limited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_equality(
            name=name,
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name,
            name2=leader,
            data=[offset, ratio, *[0.0] * 10],
            solref=robots.COUPLING_SOLREF,
            solimp=robots.COUPLING_SOLIMP,
        )
    for role, frame in plan.frames.items():
        spec.body(frame.link).add_site(name=role, pos=frame.place, quat=frame.turn, size=[0.005, 0, 0], group=4)
    _set_groups(spec, plan.drawn)
    # MuJoCo does not treat a base that is fixed to the world as a parent, and would let it touch the first link.
    pairs = {tuple(sorted((body.name, child.name))) for body in spec.bodies[1:] for child in body.bodies}
    pairs |= {tuple(sorted(pair)) for pair in plan.apart}
    for one, other in sorted(pairs):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    model = compiled(spec)
    touching = _touching(model, plan.home)
    for one, other in touching:
        spec.add_exclude(bodyname1=one, bodyname2=other)
    model = compiled(spec)
    text = precise(spec.to_xml(), model)
    used = {each.file for each in [*spec.meshes, *spec.textures]}
    used |= {file for each in spec.textures for file in each.cubefiles}
    files = {name: data for name, data in spec.assets.items() if name in used}
    return Folder(files={"robot.xml": text.encode(), **files}), touching


def compiled(spec: Any) -> Any:
    """The `mujoco.MjModel` of a spec.

    Raises:
        RuleError: MuJoCo rejects it.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise RuleError(
            "the parts do not fit together", code="DXB-B217", facts={"MuJoCo": str(error).strip()}
        ) from None


def _add_drive(spec: Any, drive: Drive) -> None:
    limits = [drive.lower, drive.upper]
    joint = spec.joint(drive.name)
    joint.range, joint.limited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
    actuator = spec.add_actuator(
        name=drive.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=drive.name,
        ctrlrange=limits,
        ctrllimited=True,
        forcerange=[-drive.effort, drive.effort],
        forcelimited=True,
    )
    actuator.set_to_position(kp=drive.stiffness, kv=drive.damping)


def _set_groups(spec: Any, named: set[str]) -> None:
    """Groups and contacts of geometry as in other robot models: visual and collision, visual only, collision only.

    Collision geometry is hidden where visual geometry covers it. A collision mesh that extends beyond the visual
    geometry of its link, such as a fingertip, is drawn.
    """
    model = compiled(spec)
    for body in spec.bodies[1:]:
        geoms, first = list(body.geoms), int(model.body(body.name).geomadr[0])
        corners = [corners_of(model, first + number) for number in range(len(geoms))]
        touching = [bool(geom.contype or geom.conaffinity) for geom in geoms]
        seen = [each for each, touches in zip(corners, touching, strict=True) if not touches]
        low = np.min([each.min(axis=0) for each in seen], axis=0) if seen else np.zeros(3)
        high = np.max([each.max(axis=0) for each in seen], axis=0) if seen else np.zeros(3)
        for geom, touches, points in zip(geoms, touching, corners, strict=True):
            out = bool(((points < low - OUT_M) | (points > high + OUT_M)).any())
            mesh = geom.type == mujoco.mjtGeom.mjGEOM_MESH
            drawn = not seen or (mesh and (out or geom.meshname in named))
            geom.group = VISUAL if not touches else SEEN if drawn else COLLISION
            if touches:
                geom.contype = geom.conaffinity = 1
                # A stated friction is that of a skin: with priority, the larger one of a contact applies.
                geom.priority = int(geom.friction[0] != 1.0)


def corners_of(model: Any, geom: int) -> np.ndarray:
    """Points (N, 3) of a geom's outline in its body [m]: vertices of a mesh, else the corners of its box."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    mesh = int(model.geom_dataid[geom])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and mesh >= 0:
        start = model.mesh_vertadr[mesh]
        points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
    else:
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        points = model.geom_aabb[geom, :3] + signs * model.geom_aabb[geom, 3:]
    return np.asarray(points @ turn.reshape(3, 3).T + model.geom_pos[geom])


def _touching(model: Any, home: Mapping[str, float]) -> list[tuple[str, str]]:
    data = mujoco.MjData(model)
    for name, position in home.items():
        data.joint(name).qpos[0] = position
    mujoco.mj_forward(model, data)
    found = set()
    for contact in data.contact:
        if contact.dist < 0:
            found.add(tuple(sorted(model.body(model.geom_bodyid[geom]).name for geom in contact.geom)))
    return sorted((one, other) for one, other in found)
