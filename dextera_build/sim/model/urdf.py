"""Write a robot as URDF, for ROS tools: links, joints, limits, inertias and shapes of its MuJoCo model.

URDF has no capsules and no ellipsoids: a capsule is a cylinder and two spheres, an ellipsoid a mesh.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import SubElement

import mujoco
import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.formats import urdf_xml
from dextera_build.formats.urdf_xml import Node
from dextera_build.geometry import quaternions
from dextera_build.sim.model import links, robot, skins, tessellate

BASE = "base"
MAIN = "robot.urdf"
NOTHING_KG = 1e-6
"""Mass of links between two joints of one body, because simulators reject moving links without mass [kg]."""


def write(robot_model: RobotModel, name: str = "robot", meshes: str = "meshes/") -> Folder:
    """`robot.urdf` with its meshes, in metres and radians; links are named as bodies, joints as joints.

    Args:
        robot_model: The robot.
        name: Name of the root element.
        meshes: Prefix of the paths of meshes in the text; the files themselves are in the folder `meshes/`.

    Raises:
        RuleError: MuJoCo rejects the robot.
    """
    model = robot.load(robot_model.model).compile()
    tree = links.tree(model, BASE)
    writer = _Writer(model, robot_model, meshes)
    root = urdf_xml.root(name)
    shapeless = {edge.child for edge in tree.edges} - tree.shifts.keys()
    for link in [BASE, *(edge.child for edge in tree.edges)]:
        node = SubElement(root, "link", name=link)
        if link in shapeless:
            _mass(node, NOTHING_KG, np.full(3, NOTHING_KG * 1e-3))
        else:
            writer.fill(node, int(model.body(link).id), tree.shifts[link])
    for edge in tree.edges:
        writer.joint(root, edge)
    return Folder(files={MAIN: urdf_xml.text(root), **dict(sorted(writer.files.items()))})


class _Writer:
    def __init__(self, model: Any, robot_model: RobotModel, meshes: str) -> None:
        self._model, self._robot, self._meshes = model, robot_model, meshes
        self._actuated = {joint.name: joint for joint in robot_model.joints}
        self._followers = {follower.name: follower for follower in robot_model.followers}
        self.files: dict[str, bytes] = {}

    def fill(self, link: Node, body: int, shift: np.ndarray) -> None:
        """Add mass and shapes of a body whose link's origin is at `shift` in its frame [m]."""
        model = self._model
        if model.body_mass[body] > 0:
            node = _mass(link, model.body_mass[body], model.body_inertia[body])
            urdf_xml.origin(node, model.body_ipos[body] - shift, quaternions.to_matrix(model.body_iquat[body]))
        first = int(model.body_geomadr[body])
        for geom in range(first, first + int(model.body_geomnum[body])):
            if model.geom_group[geom] < skins.FIRST_HIDDEN:
                for node in self._shapes(link, "visual", geom, shift):
                    colour = skins.colour(model, geom)
                    material = SubElement(node, "material", name="rgba_" + "_".join(f"{part:g}" for part in colour))
                    SubElement(material, "color", rgba=urdf_xml.numbers(colour))
            if model.geom_contype[geom] or model.geom_conaffinity[geom]:
                for _ in self._shapes(link, "collision", geom, shift):
                    pass

    def joint(self, root: Node, edge: links.Edge) -> None:
        """Add a joint with its limits; a following joint gets a mimic element."""
        node = SubElement(root, "joint", name=edge.joint, type=edge.type)
        urdf_xml.origin(node, edge.origin[:3, 3], edge.origin[:3, :3])
        SubElement(node, "parent", link=edge.parent)
        SubElement(node, "child", link=edge.child)
        if edge.type == "fixed":
            return
        SubElement(node, "axis", xyz=urdf_xml.numbers(edge.axis.tolist()))
        SubElement(node, "limit", {name: urdf_xml.number(value) for name, value in self._limits(edge.joint).items()})
        dof = int(self._model.joint(edge.joint).dofadr[0])
        resistance = {"damping": self._model.dof_damping[dof], "friction": self._model.dof_frictionloss[dof]}
        SubElement(node, "dynamics", {name: urdf_xml.number(value) for name, value in resistance.items()})
        if (follower := self._followers.get(edge.joint)) is not None:
            ratio, offset = urdf_xml.number(follower.ratio), urdf_xml.number(follower.offset)
            SubElement(node, "mimic", joint=follower.leader, multiplier=ratio, offset=offset)

    def _limits(self, name: str) -> dict[str, float]:
        if (own := self._actuated.get(name)) is not None:
            return {"lower": own.lower, "upper": own.upper, "effort": own.effort, "velocity": own.velocity}
        if (follower := self._followers.get(name)) is not None:
            leader = self._actuated[follower.leader]
            ends = sorted(follower.ratio * each + follower.offset for each in (leader.lower, leader.upper))
            speed = abs(follower.ratio) * leader.velocity
            return {"lower": ends[0], "upper": ends[1], "effort": leader.effort, "velocity": speed}
        lower, upper = self._model.joint(name).range
        return {"lower": lower, "upper": upper, "effort": 0.0, "velocity": 0.0}

    def _shapes(self, link: Node, use: str, geom: int, shift: np.ndarray) -> Iterator[Node]:
        """Add the URDF shapes of a geom."""
        model = self._model
        kind, size = int(model.geom_type[geom]), model.geom_size[geom]
        place, turn = model.geom_pos[geom] - shift, quaternions.to_matrix(model.geom_quat[geom])
        types = mujoco.mjtGeom
        if kind == types.mjGEOM_BOX:
            yield _shape(link, use, place, turn, "box", {"size": urdf_xml.numbers((2 * size).tolist())})
        elif kind == types.mjGEOM_SPHERE:
            yield _shape(link, use, place, turn, "sphere", {"radius": urdf_xml.number(size[0])})
        elif kind in (types.mjGEOM_CYLINDER, types.mjGEOM_CAPSULE):
            extent = {"radius": urdf_xml.number(size[0]), "length": urdf_xml.number(2 * size[1])}
            yield _shape(link, use, place, turn, "cylinder", extent)
            for end in (-size[1], size[1]) if kind == types.mjGEOM_CAPSULE else ():
                radius = {"radius": urdf_xml.number(size[0])}
                yield _shape(link, use, place + end * turn[:, 2], turn, "sphere", radius)
        elif kind in (types.mjGEOM_MESH, types.mjGEOM_ELLIPSOID):
            yield self._mesh(link, use, geom, place, turn)

    def _mesh(self, link: Node, use: str, geom: int, place: np.ndarray, turn: np.ndarray) -> Node:
        mesh = int(self._model.geom_dataid[geom])
        name = self._model.mesh(mesh).name if mesh >= 0 else f"geom_{geom}"
        file = f"{name.replace('/', '_')}.stl"
        self.files.setdefault(f"meshes/{file}", stl(*tessellate.surface(self._model, geom)))
        node = SubElement(link, use)
        urdf_xml.origin(node, place, turn)
        urdf_xml.mesh(node, self._meshes + file)
        return node


def _mass(link: Node, kilograms: float, moments: np.ndarray) -> Node:
    """Add mass properties with principal moments (3,) [kg m^2]; their origin is set by the caller."""
    node = SubElement(link, "inertial")
    SubElement(node, "mass", value=urdf_xml.number(kilograms))
    values = dict(zip(("ixx", "iyy", "izz"), map(urdf_xml.number, moments), strict=True))
    SubElement(node, "inertia", values | dict.fromkeys(("ixy", "ixz", "iyz"), "0.0"))
    return node


def _shape(link: Node, use: str, place: np.ndarray, turn: np.ndarray, kind: str, values: dict[str, str]) -> Node:
    node = SubElement(link, use)
    urdf_xml.origin(node, place, turn)
    SubElement(SubElement(node, "geometry"), kind, values)
    return node


def stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary STL of vertices (V, 3) [m] and faces (F, 3)."""
    corners = np.asarray(vertices, "<f4")[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)
    rows = np.zeros(len(faces), np.dtype([("numbers", "<f4", 12), ("attribute", "<u2")]))
    rows["numbers"] = np.concatenate([normals[:, None], corners], axis=1).reshape(len(faces), 12)
    out = io.BytesIO()
    out.write(b"dxb".ljust(80, b"\0"))
    out.write(np.uint32(len(faces)).astype("<u4").tobytes())
    out.write(rows.tobytes())
    return out.getvalue()
