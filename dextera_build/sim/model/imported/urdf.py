"""URDF (http://wiki.ros.org/urdf/XML) as a `mujoco.MjSpec`, with mimic and COLLADA, which MuJoCo's reader lacks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from dextera_build.errors import listing
from dextera_build.formats import bounds, xml_text
from dextera_build.geometry import quaternions
from dextera_build.sim.model.imported import elements, inertia, tree
from dextera_build.sim.model.imported import files as meshes
from dextera_build.sim.model.imported.files import wrong
from dextera_build.sim.model.imported.flat import MOST_BODIES, MOST_ELEMENTS
from dextera_build.sim.model.imported.source import WHOLE, Source

MOST_MESHES = 2_000
"""Maximum number of pairs of a mesh and a scale."""
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def read(path: str, files: Mapping[str, bytes], repair: bool = False) -> Source:
    """Read the URDF `path`.

    Args:
        path: Path of the file.
        files: Path -> content.
        repair: Replace moments of inertia that no body has, instead of raising.

    Raises:
        RuleError: It is not valid; the message names the link, the joint or the file.
        ArtifactError: It has too many links, geometries or meshes.
    """
    try:
        root = xml_text.parsed(files[path])
    except ValueError as error:
        raise wrong(f"`{path}` is not valid XML", parser=str(error)) from None
    if b"xacro" in files[path] and any("xacro" in each.tag for each in root.iter()):
        raise wrong(f"`{path}` is a xacro", hint=f"`xacro {path} > robot.urdf`, and name that file")
    if root.tag != "robot":
        raise wrong(f"`{path}` is not URDF", element=f"<{root.tag}>", hint="name a file that begins with <robot>")
    bounds.check(path, "links", len(root.findall("link")), MOST_BODIES)
    bounds.check(path, "geometries", len(root.findall("link/*/geometry")), MOST_ELEMENTS)
    _free_world(root)
    return _Reader(path, root, files, repair).read()


def _free_world(root: ET.Element) -> None:
    """Rename a link `world`, the usual name of a root that stands on the ground, because MuJoCo's world has it."""
    ends = [*root.findall("link"), *root.findall("joint/parent"), *root.findall("joint/child")]
    for element in ends:
        key = "name" if element.tag == "link" else "link"
        if element.get(key) == "world":
            element.set(key, WHOLE)


class _Reader:
    """Builds the model of one file."""

    def __init__(self, path: str, root: ET.Element, files: Mapping[str, bytes], repair: bool) -> None:
        self._path, self._root, self._files, self._repair = path, root, files, repair
        self._faults: dict[str, str] = {}
        self._links = elements.named(path, root.findall("link"), "link")
        self._joints = elements.named(path, root.findall("joint"), "joint")
        self._colours = {
            each.get("name", ""): elements.rgba(each)
            for each in root.findall("material")
            if each.find("color") is not None
        }
        self._spec = mujoco.MjSpec()
        self._spec.compiler.degree = False
        self._found = Source(self._spec)
        self._known: dict[tuple[str, tuple[float, ...]], str] = {}

    def read(self) -> Source:
        children = tree.children_of(self._links, self._joints)
        (top,) = set(self._links) - {child for group in children.values() for _, child in group}
        body = self._spec.worldbody.add_body(name=top)
        self._fill(body, top)
        waiting = [(body, top)]
        while waiting:
            parent, name = waiting.pop(0)
            for joint, child in children[name]:
                element = self._joints[joint]
                place, turn = elements.origin(element)
                below = parent.add_body(name=child, pos=place, quat=turn)
                self._fill(below, child)
                self._add_joint(below, joint, element)
                waiting.append((below, child))
        self._check_inertias()
        self._check_mimics()
        self._check_masses(children)
        return self._found

    def _check_masses(self, children: Mapping[str, list[tuple[str, str]]]) -> None:
        """Raise for moving links without mass, counting the links fixed to them."""
        for name, joint in self._joints.items():
            if joint.get("type") == "fixed":
                continue
            links = [child for group in children.values() for each, child in group if each == name]
            for link in links:
                links += [child for each, child in children[link] if self._joints[each].get("type") == "fixed"]
            if not any(self._spec.body(link).mass > 0 for link in links):
                raise wrong(
                    f"link `{links[0]}` moves by joint `{name}`, but has no mass",
                    hint="add <inertial> with mass and inertia to the link",
                )

    def _fill(self, body: Any, name: str) -> None:
        link = self._links[name]
        self._add_inertia(body, name, link.find("inertial"))
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                self._add_geom(body, name, element, kind == "collision")

    def _add_inertia(self, body: Any, name: str, element: ET.Element | None) -> None:
        mass = 0.0 if element is None else elements.number(element.find("mass"), "value", 0.0)
        body.explicitinertial = True
        if element is None or mass == 0.0:
            body.mass, body.inertia = 0.0, [0.0, 0.0, 0.0]
            return
        place, turn = elements.origin(element)
        stated = element.find("inertia")
        xx, xy, xz, yy, yz, zz = (
            elements.number(stated, key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        if (reason := inertia.fault(mass, moments)) and (mass < 0 or not self._repair):
            self._faults[name] = reason
            return
        if reason:
            moments, before = inertia.repaired(mass, moments), inertia.listed(moments)
            self._found.repaired[name] = f"{before} -> {inertia.listed(moments)} kg m^2"
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        body.mass, body.inertia, body.ipos = mass, inertia.balanced(moments), place
        body.iquat = quaternions.from_matrix(quaternions.to_matrix(turn) @ axes)

    def _check_inertias(self) -> None:
        """Raise for the first link with moments of inertia that no body has, and list all others."""
        if not self._faults:
            return
        name, reason = next(iter(self._faults.items()))
        others = [each for each in self._faults if each != name]
        raise wrong(
            f"link `{name}` has {reason}",
            **({"also": listing(others)} if others else {}),
            hint="copy them from the drawing, or compute them from the mesh and the mass; `repair_inertias: true` in "
            "the part of the recipe, or `dxb new robot --repair-inertias`, takes the nearest ones that a body can have",
        )

    def _add_joint(self, body: Any, name: str, element: ET.Element) -> None:
        kind = element.get("type", "")
        if kind not in KINDS:
            raise wrong(
                f"joint `{name}` is of type `{kind}`",
                types=listing(KINDS),
                hint="fix it, or give it a hinge or a slide",
            )
        if kind == "fixed":
            return
        axis = np.array(elements.numbers(element.find("axis"), "xyz", (1.0, 0.0, 0.0)))
        if np.linalg.norm(axis) < 1e-6:
            raise wrong(f"joint `{name}` has no axis", found=f"{axis}")
        limit = element.find("limit")
        slide = kind == "prismatic"
        made = body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis / np.linalg.norm(axis),
            damping=[elements.number(element.find("dynamics"), "damping", 0.0), 0, 0],
            frictionloss=elements.number(element.find("dynamics"), "friction", 0.0),
        )
        if kind != "continuous" and limit is not None and "lower" in limit.attrib and "upper" in limit.attrib:
            made.range = [elements.number(limit, "lower", 0.0), elements.number(limit, "upper", 0.0)]
            made.limited = True
        else:
            made.limited = False
        for key, found in (("effort", self._found.efforts), ("velocity", self._found.speeds)):
            value = elements.number(limit, key, 0.0)
            if value > 0:
                found[name] = value
        mimic = element.find("mimic")
        if mimic is not None:
            ratio, offset = elements.number(mimic, "multiplier", 1.0), elements.number(mimic, "offset", 0.0)
            self._found.mimics[name] = (mimic.get("joint", ""), ratio, offset)

    def _check_mimics(self) -> None:
        for name, (leader, _, _) in self._found.mimics.items():
            if leader not in self._joints or self._joints[leader].get("type") == "fixed":
                moving = [each for each, joint in self._joints.items() if joint.get("type") != "fixed"]
                raise wrong(
                    f"joint `{name}` mimics `{leader}`, but no joint that moves is called so",
                    joints=listing(moving, most=40),
                )

    def _add_geom(self, body: Any, link: str, element: ET.Element, collides: bool) -> None:
        shape = element.find("geometry")
        shape = shape[0] if shape is not None and len(shape) else None
        if shape is None:
            raise wrong(f"a geometry of link `{link}` is empty")
        place, turn = elements.origin(element)
        geom = body.add_geom(pos=place, quat=turn, density=0.0)
        if not collides:
            geom.contype = geom.conaffinity = 0
        colour = self._colour(element)
        if colour is not None:
            geom.rgba = colour
        if shape.tag == "mesh":
            geom.type = mujoco.mjtGeom.mjGEOM_MESH
            geom.meshname = self._mesh(shape)
        elif shape.tag == "box":
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, [each / 2 for each in elements.numbers(shape, "size")]
        elif shape.tag == "sphere":
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [elements.number(shape, "radius"), 0, 0]
        elif shape.tag in ("cylinder", "capsule"):
            kinds = {"cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER, "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE}
            geom.type = kinds[shape.tag]
            geom.size = [elements.number(shape, "radius"), elements.number(shape, "length") / 2, 0]
        else:
            raise wrong(f"link `{link}` has a geometry <{shape.tag}>", shapes="mesh, box, cylinder, capsule, sphere")

    def _mesh(self, shape: ET.Element) -> str:
        """Name of a mesh, which is added once per file and scale."""
        path = meshes.found(shape.get("filename", ""), self._path, self._files)
        scale = tuple(elements.numbers(shape, "scale", (1.0, 1.0, 1.0)))
        if (path, scale) not in self._known:
            file, data = meshes.mesh(path, self._files[path])
            name = f"mesh_{len(self._known)}"
            file = f"{name}_{file}"
            self._known[path, scale] = name
            bounds.check(self._path, "meshes", len(self._known), MOST_MESHES)
            self._spec.add_mesh(name=name, file=file, scale=scale)
            self._spec.assets = {**self._spec.assets, file: data}
        return self._known[path, scale]

    def _colour(self, element: ET.Element) -> list[float] | None:
        material = element.find("material")
        if material is None:
            return None
        return (
            elements.rgba(material)
            if material.find("color") is not None
            else self._colours.get(material.get("name", ""))
        )
