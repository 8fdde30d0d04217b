"""simulate.urdf: one asset as a URDF folder for ROS tools and simulators."""

from __future__ import annotations

import json
from xml.etree.ElementTree import SubElement

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.objects.object import Asset, Inertial, Joint
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.formats import obj, urdf_xml
from dextera_build.formats.urdf_xml import Node
from dextera_build.geometry import convex
from dextera_build.rule import Context, Options, rule

from .amounts import amount


class UrdfOptions(Options):
    """Options of simulate.urdf: joint properties required by URDF but not visible in a photograph."""

    name: str = ""
    """Name of the robot element; empty: the object's category."""
    effort_nm: PositiveFloat = 5.0
    """Maximum torque or force of a joint [N m or N]."""
    velocity_rad_s: PositiveFloat = 5.0
    """Maximum speed of a joint [rad/s or m/s]."""
    damping: NonNegativeFloat = 0.02
    """Viscous damping of a joint [N m s/rad or N s/m]."""
    friction: NonNegativeFloat = 0.1
    """Dry friction of a joint [N m or N]; holds a lid in place."""


@rule(version=3, packages=("scipy",))
def urdf(ctx: Context, asset: Asset, *, options: UrdfOptions) -> Folder:
    """Return `object.urdf` with its meshes, in metres and radians, all paths relative.

    A link's frame is at the origin of its parent joint and parallel to the object frame with all joints at 0; the root
    link's frame is the object frame. `placement.json` contains the object's pose in the world and its joint positions,
    which URDF cannot represent.
    """
    files: dict[str, bytes] = {}
    robot = urdf_xml.root(options.name or asset.category)
    origins = {joint.child: joint.origin for joint in asset.body.joints}
    for name, link in asset.body.links.items():
        origin = np.array(origins.get(name, (0.0, 0.0, 0.0)))
        node = SubElement(robot, "link", name=name)
        _inertial(node, asset.physics.links[name], origin)
        _visual(node, files, name, link.mesh, origin)
        for number, hull in enumerate(asset.collision.links[name].hulls):
            _collision(node, files, f"{name}_collision_{number:03d}", hull, origin)
    for joint in asset.body.joints:
        _joint(robot, joint, origins, options)
    files["object.urdf"] = urdf_xml.text(robot)
    files["placement.json"] = _placement(asset)
    size = sum(len(data) for data in files.values()) / 1e6
    parts = amount(len(asset.body.links), "link"), amount(len(asset.body.joints), "joint"), amount(len(files), "file")
    ctx.say(f"{', '.join(parts)}, {size:.1f} MB")
    return Folder(files=files)


def _inertial(node: Node, inertial: Inertial, origin: np.ndarray) -> None:
    part = SubElement(node, "inertial")
    urdf_xml.origin(part, np.array(inertial.centre) - origin)
    SubElement(part, "mass", value=urdf_xml.number(inertial.mass_kg))
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = {name: urdf_xml.number(value) for name, value in zip(names, inertial.inertia, strict=True)}
    SubElement(part, "inertia", values)


def _visual(node: Node, files: dict[str, bytes], name: str, mesh: Mesh, origin: np.ndarray) -> None:
    moved = mesh.model_copy(update={"vertices": (mesh.vertices - origin).astype(np.float32)})
    files[f"meshes/{name}.obj"] = obj.text(moved, f"{name}.mtl").encode()
    rgba = [*mesh.colour, 1.0]
    lines = ["newmtl surface", "Kd {:.4f} {:.4f} {:.4f}".format(*mesh.colour)]
    if mesh.texture is not None:
        files[f"meshes/{name}.png"] = png(mesh.texture.pixels)
        lines[1:] = ["Kd 1 1 1", f"map_Kd {name}.png"]
        rgba = [1.0, 1.0, 1.0, 1.0]
    files[f"meshes/{name}.mtl"] = ("\n".join(lines) + "\n").encode()
    part = SubElement(node, "visual", name=f"{name}_visual")
    urdf_xml.origin(part, np.zeros(3))
    urdf_xml.mesh(part, f"meshes/{name}.obj")
    material = SubElement(part, "material", name=f"{name}_material")
    SubElement(material, "color", rgba=urdf_xml.numbers(rgba))
    if mesh.texture is not None:
        SubElement(material, "texture", filename=f"meshes/{name}.png")


def _collision(node: Node, files: dict[str, bytes], name: str, hull: Hull, origin: np.ndarray) -> None:
    vertices, faces = convex.surface(hull.vertices.astype(np.float64) - origin)
    mesh = Mesh(vertices=vertices, faces=faces)
    files[f"meshes/{name}.obj"] = obj.text(mesh).encode()
    part = SubElement(node, "collision", name=name)
    urdf_xml.origin(part, np.zeros(3))
    urdf_xml.mesh(part, f"meshes/{name}.obj")


def _joint(robot: Node, joint: Joint, origins: dict[str, tuple[float, float, float]], options: UrdfOptions) -> None:
    node = SubElement(robot, "joint", name=joint.name, type=joint.type)
    parent = np.array(origins.get(joint.parent, (0.0, 0.0, 0.0)))
    urdf_xml.origin(node, np.array(joint.origin) - parent)
    SubElement(node, "parent", link=joint.parent)
    SubElement(node, "child", link=joint.child)
    SubElement(node, "axis", xyz=urdf_xml.numbers(joint.axis))
    limits = {"lower": joint.lower, "upper": joint.upper, "effort": options.effort_nm}
    limits["velocity"] = options.velocity_rad_s
    SubElement(node, "limit", {name: urdf_xml.number(value) for name, value in limits.items()})
    dynamics = {"damping": urdf_xml.number(options.damping), "friction": urdf_xml.number(options.friction)}
    SubElement(node, "dynamics", dynamics)


def _placement(asset: Asset) -> bytes:
    data = {
        "world_from_object": asset.pose.matrix.tolist(),
        "joint_positions": {joint.name: joint.position for joint in asset.body.joints},
        "friction": asset.physics.friction,
        "restitution": asset.physics.restitution,
    }
    return (json.dumps(data, indent=1, sort_keys=True) + "\n").encode()
