"""Combine bodies and meshes of published robot models with the drives and frames of an existing model."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.sim.model import robot as robots

SEEN, VISUAL, COLLISION = 0, 2, 3
"""Geom groups: visible with collision, visual only, collision only; the last is not drawn, as in a twin's scene."""
LIMIT_RAD = 1e-3
"""Tolerance of equal joint limits [rad]."""


@dataclass(frozen=True)
class Part:
    """One MJCF file and the selection from it."""

    file: Path
    """Path of the MJCF."""
    root: str
    """Body whose subtree is used, placed at the link of the same name in the model."""
    prefix: str = ""
    """Prefix of its mesh names."""
    renamed: dict[str, str] = field(default_factory=dict)
    """Body in the file -> link."""
    drawn: tuple[str, ...] = ()
    """Meshes that collide and are visible; other collision geoms are represented by their visual counterpart."""

    def link(self, body: str) -> str:
        """Name of a body's link."""
        return self.renamed.get(body, body)


def dressed(model: RobotModel, parts: list[Part]) -> Folder:
    """Build the robot with kinematics, masses and geometry from `parts`, and everything else from `model`.

    `model` provides the pose of each part's root, armature and dry friction, the actuators with their limits, the
    frames, the pairs excluded from contact, and the inertia of links without one in the file. Contact parameters are
    MuJoCo's defaults, as in `model`.

    Raises:
        RuleError: A file does not load, lacks a link or a joint, or has other limits.
    """
    assembly = _Assembly(robots.load(model.model))
    for part in parts:
        assembly.add(part)
    _check_names(model, assembly.bodies)
    return assembly.finished()


def misplaced(part: Part, robot: Folder) -> float:
    """Largest difference of geom poses between the robot and the part's own file: m, or rotation matrix entries.

    Both are compared with all joints at 0, relative to the part's root. Missing geoms give infinity.
    """
    whole = _places(robots.load(robot).compile(), part.link(part.root))
    worst = 0.0
    for body, places in _places(mujoco.MjModel.from_xml_path(str(part.file)), part.root).items():
        found = whole.get(part.link(body), np.zeros((0, 12)))
        if len(places):
            worst = max(worst, float(np.abs(places - found).max()) if places.shape == found.shape else np.inf)
    return worst


class _Assembly:
    """A robot assembled from parts.

    Args:
        old: `MjSpec` of the model that provides drives and frames.
    """

    def __init__(self, old: Any) -> None:
        self._old = old
        self._spec = mujoco.MjSpec()
        self._spec.modelname = old.modelname
        self._spec.compiler.degree = False
        self._spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._files: dict[str, bytes] = {}
        self.bodies: dict[str, Any] = {}
        """Link -> its body."""

    def add(self, part: Part) -> None:
        """Add a part's bodies, joints, geoms and meshes."""
        source = _read(part)
        for mesh in source.meshes:
            name = f"meshes/{part.prefix}{Path(mesh.file).name}"
            self._files[name] = Path(source.modelfiledir, source.meshdir, mesh.file).read_bytes()
            self._spec.add_mesh(name=part.prefix + mesh.name, file=name, scale=mesh.scale)
        place = self._old.body(part.link(part.root))
        if place is None:
            raise RuleError(f"no link is called `{part.link(part.root)}`", code="DXB-B214", hint="name it in `links`")
        above = place.parent.name
        parent = self._spec.worldbody if above == "world" else self.bodies.get(above)
        if parent is None:
            raise RuleError(f"`{part.root}` is attached to `{above}`, which no part before it has", code="DXB-B214")
        colours = {material.name: material.rgba for material in source.materials}
        self._add_body(parent, source.body(part.root), place, part, colours)

    def _add_body(self, parent: Any, source: Any, place: Any, part: Part, colours: dict[str, Any]) -> None:
        name = part.link(source.name)
        known = self._old.body(name)
        if known is None:
            if not (list(source.geoms) or list(source.joints) or list(source.bodies)):
                return  # a bare frame
            raise RuleError(
                f"`{part.file.name}` has a body `{source.name}`, but no link is called so",
                code="DXB-B214",
                facts={"links": listing((body.name for body in self._old.bodies), most=40)},
                hint="name it in `links`",
            )
        body = parent.add_body(name=name, pos=place.pos, quat=place.quat)
        inertial = source if source.explicitinertial else known
        body.explicitinertial = True
        body.mass, body.ipos = inertial.mass, inertial.ipos
        body.iquat, body.inertia = inertial.iquat, inertial.inertia
        self.bodies[name] = body
        for joint in source.joints:
            body.add_joint(
                name=joint.name, type=joint.type, axis=joint.axis, pos=joint.pos, range=joint.range, limited=True
            )
        for geom in source.geoms:
            _add_geom(body, geom, part, colours)
        for child in source.bodies:
            self._add_body(body, child, child, part, colours)

    def finished(self) -> Folder:
        """Add drives and frames, and return MJCF and meshes."""
        for joint in self._old.joints:
            self._spec.joint(joint.name).armature = joint.armature
            self._spec.joint(joint.name).frictionloss = joint.frictionloss
        for drive in self._old.actuators:
            self._spec.add_actuator(**{name: getattr(drive, name) for name in _DRIVE})
        for site in self._old.sites:
            self.bodies[site.parent.name].add_site(**{name: getattr(site, name) for name in _FRAME})
        for pair in self._old.excludes:
            self._spec.add_exclude(bodyname1=pair.bodyname1, bodyname2=pair.bodyname2)
        self._spec.assets = self._files
        try:
            self._spec.compile()
        except ValueError as error:
            raise RuleError("the parts do not fit together", code="DXB-B214", facts={"MuJoCo": error}) from None
        return Folder(files={"robot.xml": self._spec.to_xml().encode(), **self._files})


_DRIVE = (
    *("name", "trntype", "target", "ctrlrange", "ctrllimited", "forcerange", "forcelimited"),
    *("gaintype", "gainprm", "biastype", "biasprm", "dyntype", "dynprm"),
)
_FRAME = ("name", "pos", "quat", "size", "group")


def _read(part: Part) -> Any:
    try:
        source = mujoco.MjSpec.from_file(str(part.file))
    except ValueError as error:
        raise RuleError(f"`{part.file.name}` does not load", code="DXB-B213", facts={"MuJoCo": error}) from None
    if source.body(part.root) is None:
        known = listing((body.name for body in source.bodies), most=40)
        raise RuleError(f"`{part.file.name}` has no body `{part.root}`", code="DXB-B213", facts={"bodies": known})
    return source


def _add_geom(body: Any, source: Any, part: Part, colours: dict[str, Any]) -> None:
    touches = bool(source.contype or source.conaffinity)
    group = VISUAL if not touches else SEEN if source.meshname in part.drawn else COLLISION
    geom = body.add_geom(type=source.type, pos=source.pos, quat=source.quat, group=group)
    if source.type == mujoco.mjtGeom.mjGEOM_MESH:
        geom.meshname = part.prefix + source.meshname
    else:
        geom.size, geom.fromto = source.size, source.fromto
    geom.rgba = colours.get(source.material, source.rgba)
    if not touches:
        geom.contype = geom.conaffinity = 0


def _check_names(model: RobotModel, bodies: dict[str, Any]) -> None:
    if missing := sorted(set(model.links) - set(bodies)):
        raise RuleError(f"no part has the link `{missing[0]}`", code="DXB-B214", facts={"missing": listing(missing)})
    found = {joint.name: joint for body in bodies.values() for joint in body.joints}
    for joint in model.joints:
        if joint.name not in found:
            raise RuleError(f"no part has the joint `{joint.name}`", code="DXB-B214", facts={"joints": listing(found)})
        low, high = found[joint.name].range
        if max(abs(low - joint.lower), abs(high - joint.upper)) > LIMIT_RAD:
            raise RuleError(
                f"the limits of joint `{joint.name}` differ from those of the model",
                code="DXB-B214",
                facts={"file": f"{low:g} to {high:g} rad", "model": f"{joint.lower:g} to {joint.upper:g} rad"},
            )


def _places(model: Any, root: str) -> dict[str, np.ndarray]:
    """Body -> (G, 12) positions [m] and rotations of its geoms in the frame of body `root`, all joints at 0."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, turn = data.body(root).xpos, data.body(root).xmat.reshape(3, 3).T
    positions = (data.geom_xpos - origin) @ turn.T
    rotations = turn @ data.geom_xmat.reshape(-1, 3, 3)
    rows = np.hstack([positions, rotations.reshape(-1, 9)])
    return {model.body(number).name: rows[model.geom_bodyid == number] for number in range(1, model.nbody)}
