"""Content of a scene as numbers in the world frame: two files of one scene have the same inventory.

`of_model` lists the content of a compiled MuJoCo model, `sim.usd.reader` that of a stage; `differences` compares two
lists. Poses are those of the home keyframe.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from dextera_build.geometry import transforms
from dextera_build.sim.model import mjcf_contact, tessellate
from dextera_build.sim.model.model import at_home

WORLD = "world"
"""The body that holds all static colliders."""
LENGTH_M = 1e-5
"""Maximum difference of a position: single precision of coordinates below 100 m."""
RELATIVE = 1e-5
"""Maximum relative difference of all other numbers."""
_PLACES = ("anchor", "centre", "gap", "position", "target")
_KINDS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
}
_HULLS = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_ELLIPSOID)
CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
"""(8, 3) of a box with half edges of 1."""


@dataclass(frozen=True)
class Collider:
    """A convex collision shape."""

    kind: str
    """`hull`, `sphere`, `capsule` or `cylinder`."""
    points: np.ndarray
    """Corners (N, 3) of a hull; of other shapes the ends (2, 3) of the axis without caps, or the centre (1, 3) [m]."""
    radius: float
    """0 of a hull [m]."""
    friction: float
    """Sliding friction; 0: the other side's applies."""
    restitution: float
    """Coefficient of restitution; 0: the other side's applies."""


@dataclass(frozen=True)
class BodyEntry:
    """A rigid body."""

    mass: float
    """[kg]"""
    centre: np.ndarray
    """Centre of mass (3,) [m]."""
    inertia: np.ndarray
    """(3, 3) about the centre of mass [kg m^2]."""
    weightless: bool
    """Whether gravity does not act on it."""
    colliders: tuple[Collider, ...] = ()
    """Colliders in order."""


@dataclass(frozen=True)
class JointEntry:
    """A hinge or a slide, in rad, N m or m, N."""

    kind: Literal["revolute", "prismatic", "fixed"]
    """Kind of motion."""
    parent: str
    """Body nearer to the root, or `world`."""
    child: str
    """Moving body."""
    anchor: np.ndarray
    """(3,) on the axis [m]."""
    axis: np.ndarray
    """(3,) unit vector; 0 of a fixed joint."""
    limits: tuple[float, float] = (-np.inf, np.inf)
    """Lower and upper limit."""
    position: float = 0.0
    """Position in the home keyframe."""
    friction: float = 0.0
    """Dry friction."""
    armature: float = 0.0
    """Reflected inertia of the motor."""
    stiffness: float = 0.0
    """Stiffness of its position drive; 0 without one."""
    damping: float = 0.0
    """Damping of joint and drive together."""
    effort: float = np.inf
    """Largest torque or force of its drive."""
    target: float = 0.0
    """Target of its drive in the home keyframe."""
    follows: tuple[str, float, float] = ("", 0.0, 0.0)
    """Leader, ratio and offset of a follower."""
    gap: float = 0.0
    """Constraint error between both bodies; 0 in MuJoCo [m or rad]."""


@dataclass
class Inventory:
    """All moving, carrying and colliding parts of a scene."""

    bodies: dict[str, BodyEntry] = field(default_factory=dict)
    """Name -> body; `world` has no mass."""
    joints: dict[str, JointEntry] = field(default_factory=dict)
    """Name -> joint."""
    apart: set[tuple[str, str]] = field(default_factory=set)
    """Sorted pairs of bodies excluded from contact, except for `touch`."""
    touch: set[tuple[tuple[str, int], tuple[str, int]]] = field(default_factory=set)
    """Sorted pairs of colliders, (body, number), that may touch although their bodies are excluded."""


def of_model(model: Any) -> Inventory:
    """The inventory of a compiled MuJoCo scene in its keyframe `home`.

    Bodies that are welded to the world and carry no joint are static: their colliders are the world's.
    """
    data = at_home(model)
    found = Inventory()
    owners = [_owner(model, body) for body in range(model.nbody)]
    numbers: dict[int, tuple[str, int]] = {}
    colliders: dict[str, list[Collider]] = {WORLD: []}
    for geom in range(model.ngeom):
        if model.geom_contype[geom] or model.geom_conaffinity[geom]:
            own = colliders.setdefault(owners[model.geom_bodyid[geom]], [])
            numbers[geom] = (owners[model.geom_bodyid[geom]], len(own))
            own.append(_collider(model, data, geom))
    found.bodies[WORLD] = BodyEntry(0.0, np.zeros(3), np.zeros((3, 3)), False, tuple(colliders[WORLD]))
    for body in range(1, model.nbody):
        name = model.body(body).name
        if owners[body] == name and model.body_mass[body] > 0:
            found.bodies[name] = _body(model, data, body, tuple(colliders.get(name, ())))
            _join(model, data, body, owners, found)
    _set_drives(model, data, found)
    _couple(model, found)
    _separate(model, owners, found)
    for pair in range(model.npair):
        one, other = sorted(numbers[int(geom[pair])] for geom in (model.pair_geom1, model.pair_geom2))
        found.touch.add((one, other))
    _simplify(found)
    return found


def differences(one: Inventory, other: Inventory, most: int = 20) -> list[str]:
    """Differences between two inventories beyond single precision, one line each; empty if there are none."""
    found: list[str] = []
    for kind in ("bodies", "joints"):
        ours, theirs = getattr(one, kind), getattr(other, kind)
        found += [f"{kind}: `{name}` is missing on one side" for name in sorted(ours.keys() ^ theirs.keys())]
        for name in sorted(ours.keys() & theirs.keys()):
            found += [f"{name}: {line}" for line in _unequal(ours[name], theirs[name])]
    for kind in ("apart", "touch"):
        found += [f"{kind}: {pair} on one side alone" for pair in sorted(getattr(one, kind) ^ getattr(other, kind))]
    return found[:most]


def _unequal(one: Any, other: Any) -> Iterator[str]:
    for each in fields(one):
        ours, theirs = getattr(one, each.name), getattr(other, each.name)
        if each.name == "colliders":
            if len(ours) != len(theirs):
                yield f"{len(ours)} and {len(theirs)} colliders"
            for number, (first, second) in enumerate(zip(ours, theirs, strict=False)):
                yield from (f"collider {number}: {line}" for line in _unequal(first, second))
        elif each.name == "points":
            if one.kind == other.kind and _apart(ours, theirs) > LENGTH_M:
                yield f"{_apart(ours, theirs):.2g} m elsewhere"
        elif not _same(each.name, ours, theirs):
            yield f"{each.name} {ours} and {theirs}"


def _same(name: str, ours: Any, theirs: Any) -> bool:
    if isinstance(ours, str | bool):
        return bool(ours == theirs)
    if name == "follows":
        return bool(ours[0] == theirs[0]) and _close(np.array(ours[1:]), np.array(theirs[1:]), 1.0)
    size = LENGTH_M / RELATIVE if name in _PLACES else _size(ours)
    return _close(np.array(ours, float), np.array(theirs, float), size)


def _size(value: Any) -> float:
    return max(float(np.abs(np.nan_to_num(np.array(value, float), posinf=0.0, neginf=0.0)).max()), 1e-9)


def _close(ours: np.ndarray, theirs: np.ndarray, size: float) -> bool:
    return bool(np.allclose(ours, theirs, rtol=RELATIVE, atol=RELATIVE * size))


def _apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest distance from a point of one set to the other set [m]."""
    return float(max(np.max(cKDTree(theirs).query(ours)[0]), np.max(cKDTree(ours).query(theirs)[0])))


def _owner(model: Any, body: int) -> str:
    """The rigid body that a body's geoms belong to: itself, or its parent if it has neither joint nor mass."""
    while body and not model.body_jntnum[body] and (not model.body_mass[body] or _is_static(model, body)):
        body = int(model.body_parentid[body])
    return str(model.body(body).name) if body else WORLD


def _is_static(model: Any, body: int) -> bool:
    """Whether a body is welded to the world and has no moving descendants."""
    moved = model.body_weldid != 0
    below = np.flatnonzero(model.body_rootid == model.body_rootid[body])
    return not model.body_weldid[body] and not moved[below].any()


def _body(model: Any, data: Any, body: int, colliders: tuple[Collider, ...]) -> BodyEntry:
    turn = data.ximat[body].reshape(3, 3)
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    floats = bool(model.body_gravcomp[body] == 1.0)
    return BodyEntry(float(model.body_mass[body]), data.xipos[body].copy(), inertia, floats, colliders)


def _collider(model: Any, data: Any, geom: int) -> Collider:
    kind, pose = (
        mujoco.mjtGeom(int(model.geom_type[geom])),
        transforms.rigid(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]),
    )
    radius, half = float(model.geom_size[geom, 0]), float(model.geom_size[geom, 1])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        points, radius = CORNERS * model.geom_size[geom], 0.0
    elif kind in _HULLS:
        points, radius = tessellate.surface(model, geom)[0], 0.0
    elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        points = np.zeros((1, 3))
    else:
        points = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])
    decides = bool(model.geom_priority[geom])
    return Collider(
        _KINDS.get(kind, "hull"),
        transforms.apply(pose, points),
        radius,
        float(model.geom_friction[geom, 0]) if decides else 0.0,
        mjcf_contact.bounce(float(model.geom_solref[geom, 1])) if decides else 0.0,
    )


def _join(model: Any, data: Any, body: int, owners: list[str], found: Inventory) -> None:
    """Add the joint of a body; a free body has none."""
    name, parent = owners[body], owners[model.body_parentid[body]]
    anchor, axis = data.xpos[body].copy(), np.zeros(3)
    if not model.body_jntnum[body]:
        found.joints[f"fixed {name}"] = JointEntry("fixed", parent, name, anchor, axis)
        return
    joint = int(model.body_jntadr[body])
    kind = mujoco.mjtJoint(int(model.jnt_type[joint]))
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return
    dof, position = model.jnt_dofadr[joint], float(data.qpos[model.jnt_qposadr[joint]])
    low, high = (float(each) for each in model.jnt_range[joint])
    found.joints[model.joint(joint).name] = JointEntry(
        "revolute" if kind == mujoco.mjtJoint.mjJNT_HINGE else "prismatic",
        parent,
        name,
        data.xanchor[joint].copy(),
        data.xaxis[joint].copy(),
        (low, high) if model.jnt_limited[joint] else (-np.inf, np.inf),
        position,
        friction=float(model.dof_frictionloss[dof]),
        armature=float(model.dof_armature[dof]),
        damping=float(model.dof_damping[dof]),
        target=position,
    )


def _set_drives(model: Any, data: Any, found: Inventory) -> None:
    for number in range(model.nu):
        name = model.joint(int(model.actuator_trnid[number, 0])).name
        joint = found.joints[name]
        limited = model.actuator_forcelimited[number]
        found.joints[name] = _changed(
            joint,
            stiffness=float(model.actuator_gainprm[number, 0]),
            damping=joint.damping - float(model.actuator_biasprm[number, 2]),
            effort=float(model.actuator_forcerange[number, 1]) if limited else np.inf,
            target=float(data.ctrl[number]),
        )


def _couple(model: Any, found: Inventory) -> None:
    for number in range(model.neq):
        if model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT:
            name, leader = (model.joint(int(each[number])).name for each in (model.eq_obj1id, model.eq_obj2id))
            offset, ratio = (float(each) for each in model.eq_data[number, :2])
            found.joints[name] = _changed(found.joints[name], follows=(leader, ratio, offset))


def _separate(model: Any, owners: list[str], found: Inventory) -> None:
    """Pairs of bodies without contact: those excluded, and those that a joint connects."""
    for joint in found.joints.values():
        if joint.parent != WORLD:
            found.apart.add(_sorted(joint.parent, joint.child))
    for number in range(model.nexclude):
        signature = int(model.exclude_signature[number])
        found.apart.add(_sorted(owners[signature >> 16], owners[signature & 0xFFFF]))
    found.apart = {(one, other) for one, other in found.apart if one != other}


def _simplify(found: Inventory) -> None:
    """Bodies all of whose colliders may touch are not excluded."""
    for one, other in sorted(found.apart):
        pairs = {pair for pair in found.touch if (pair[0][0], pair[1][0]) == (one, other)}
        if pairs and len(pairs) == len(found.bodies[one].colliders) * len(found.bodies[other].colliders):
            found.apart.remove((one, other))
            found.touch -= pairs


def _sorted(one: str, other: str) -> tuple[str, str]:
    return (one, other) if one < other else (other, one)


def _changed(joint: JointEntry, **changes: Any) -> JointEntry:
    return JointEntry(**{**{each.name: getattr(joint, each.name) for each in fields(joint)}, **changes})
