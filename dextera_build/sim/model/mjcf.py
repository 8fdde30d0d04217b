"""Write a scene description as MJCF: a pure function to the bytes of `scene.xml` and its files.

Visual geoms are group 2 without collision; collision geoms are group 3 convex pieces. Mass properties are always
explicit, because MuJoCo's estimate from meshes is wrong for thin and open ones. A link's body is at its joint's origin
with the object's axes; a root body is at the object's frame. Direction and limits of hinges are as in `JointNode`;
keyframe `home` holds the poses and positions of the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.scenes.scene_description import (
    BodyNode,
    Box,
    CameraNode,
    Contact,
    Geom,
    JointNode,
    Light,
    ObjectNode,
    SceneDescription,
)
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.formats import obj
from dextera_build.geometry import convex, quaternions
from dextera_build.geometry.cameras import GL_FROM_CV
from dextera_build.sim.model import mjcf_contact, names

PIXEL_M = 1e-6
"""Nominal sensor pitch of the camera; only ratios matter [m]."""

LIT = 0.12
"""Fraction of an unlit texture's brightness that comes from the scene's lights, so that contact shadows are faint."""
LIGHTS = 1.1
"""Sum of headlight and lights on a surface that faces both the camera and the lights halfway."""

Element = ElementTree.Element


def write(description: SceneDescription) -> Folder:
    """Write a scene.

    Returns:
        `scene.xml` with `assets/*.obj` and `assets/*.png`; byte-identical for the same scene.

    Raises:
        RuleError: It has robots, which `attached.write` adds.
    """
    if description.attachments:
        raise RuleError(
            "the scene has robots, which MJCF text alone cannot hold",
            code="DXB-B216",
            facts={"robots": ", ".join(each.prefix for each in description.attachments)},
            hint="write it with `sim.model.attached.write`",
        )
    return _Writer(description).folder()


def numbers(values: Sequence[float] | np.ndarray) -> str:
    """Format numbers as MJCF attributes: nine significant digits, no negative zero."""
    return " ".join(f"{float(value) + 0.0:.9g}" for value in values)


class _Writer:
    """Collects elements and files from the nodes."""

    def __init__(self, description: SceneDescription) -> None:
        self.scene = description
        self.files: dict[str, bytes] = {}
        self.textures: dict[str, str] = {}
        self.home: list[str] = []
        self.root = Element("mujoco", model="twin")
        self.asset = Element("asset")
        self.contact = Element("contact")
        self.world = Element("worldbody")

    def folder(self) -> Folder:
        self._head()
        sky = numbers(np.array(self.scene.backdrop).round(3))
        _add(
            self.asset, "texture", name="sky", type="skybox", builtin="flat", rgb1=sky, rgb2=sky, width="8", height="48"
        )
        for light in self.scene.lights:
            self._light(light)
        for camera in self.scene.cameras:
            self._camera(camera)
        for geom in self.scene.static:
            self._geom(self.world, geom)
        for thing in self.scene.objects:
            self._link(self.world, thing, thing.root, None, np.zeros(3))
        for first, second in self.scene.exclude:
            _add(self.contact, "exclude", body1=first, body2=second)
        self._touch()
        self.root.extend([self.asset, self.world])
        if len(self.contact):
            self.root.append(self.contact)
        if self.home:
            keys = _add(self.root, "keyframe")
            _add(keys, "key", name="home", qpos=" ".join(self.home))
        ElementTree.indent(self.root, "  ")
        text = ElementTree.tostring(self.root, encoding="unicode") + "\n"
        return Folder(files={"scene.xml": text.encode(), **dict(sorted(self.files.items()))})

    def _touch(self) -> None:
        """Contacts of an object with itself, which body filters do not exclude."""
        bodies = [body for thing in self.scene.objects for body in thing.links.values()]
        geoms = {geom.label: geom for body in bodies for geom in body.geoms}
        masses = {
            geom.label: thing.mass_kg
            for thing in self.scene.objects
            for body in thing.links.values()
            for geom in body.geoms
        }
        for first, second in self.scene.touch:
            contact = geoms[first].contact
            more = {}
            if contact is not None:
                more["solref"] = numbers(_solref(contact, masses[first]))
                slide, turn, roll = mjcf_contact.friction(contact.friction)
                more["friction"] = numbers((slide, slide, turn, roll, roll))
            _add(self.contact, "pair", more, geom1=first, geom2=second, condim="4")

    def _head(self) -> None:
        root = self.root
        _add(root, "compiler", angle="radian", meshdir="assets", texturedir="assets")
        # MuJoCo 4.0.0 diverges with sparse Jacobians; elliptic cones with a high impratio keep resting objects at rest.
        _add(root, "option", jacobian="dense", integrator="implicitfast", cone="elliptic", impratio="10")
        visual = _add(root, "visual")
        if self.scene.cameras:
            camera = self.scene.cameras[0].camera
            _add(visual, "global", offwidth=str(camera.width), offheight=str(camera.height))
        _add(visual, "quality", shadowsize="4096", offsamples="4")
        _add(visual, "headlight", ambient="0.45 0.45 0.45", diffuse="0.4 0.4 0.4", specular="0 0 0")
        _add(visual, "map", znear="0.01", zfar="50")
        places = [thing.pose.matrix[:3, 3] for thing in self.scene.objects]
        middle = np.mean(places, axis=0) if places else np.zeros(3)
        _add(root, "statistic", center=numbers(middle.round(3)), extent="1", meansize="0.05")
        defaults = _add(root, "default")
        looks = _add(defaults, "default", {"class": "visual"})
        _add(looks, "mesh", inertia="shell")
        _add(looks, "geom", type="mesh", group="2", contype="0", conaffinity="0", mass="0")
        solid = _add(defaults, "default", {"class": "collision"})
        _add(solid, "geom", group="3", condim="4", solref=numbers(mjcf_contact.solref(0.0)), rgba="0.3 0.6 0.9 0.4")

    def _light(self, light: Light) -> None:
        _add(
            self.world,
            "light",
            name=light.label,
            type="directional",
            pos=numbers(light.place),
            dir=numbers(light.direction),
            diffuse=numbers(light.diffuse),
            specular="0 0 0",
        )

    def _camera(self, node: CameraNode) -> None:
        camera, gl = node.camera, node.pose.matrix @ GL_FROM_CV
        # The offset is from the image centre, half a pixel from the integer pixel centres; y is up since 3.6.
        offset = (camera.width / 2 - camera.cx - 0.5, camera.height / 2 - camera.cy - 0.5)
        _add(
            self.world,
            "camera",
            name=node.label,
            pos=numbers(gl[:3, 3]),
            quat=numbers(quaternions.from_matrix(gl[:3, :3])),
            resolution=f"{camera.width} {camera.height}",
            sensorsize=numbers((camera.width * PIXEL_M, camera.height * PIXEL_M)),
            focalpixel=numbers((camera.fx, camera.fy)),
            principalpixel=numbers(offset),
        )

    def _link(self, parent: Element, thing: ObjectNode, part: str, joint: JointNode | None, outer: np.ndarray) -> None:
        """Add a part's body and its descendants; `outer` is the parent's origin in the object frame [m]."""
        node, origin = thing.links[part], thing.origin(part)
        body = _add(parent, "body", name=node.label)
        if joint is None:
            self._root(body, node.label, thing.pose.matrix)
        else:
            body.set("pos", numbers(origin - outer))
            self._joint(body, f"{node.label}_{names.plain(joint.name)}", joint)
        self._mass(body, node)
        for geom in node.geoms:
            self._geom(body, geom, thing.mass_kg)
        for beyond in thing.joints:
            if beyond.parent == part:
                self._link(body, thing, beyond.child, beyond, origin)

    def _root(self, body: Element, name: str, place: np.ndarray) -> None:
        position, turn = numbers(place[:3, 3]), numbers(quaternions.from_matrix(place[:3, :3]))
        body.set("pos", position)
        body.set("quat", turn)
        _add(body, "freejoint", name=name)
        self.home += [position, turn]

    def _joint(self, body: Element, name: str, joint: JointNode) -> None:
        _add(
            body,
            "joint",
            name=name,
            type="hinge" if joint.type == "revolute" else "slide",
            axis=numbers(joint.axis),
            range=numbers((joint.lower, joint.upper)),
            limited="true",
            frictionloss=numbers([joint.friction]),
            damping=numbers([joint.damping]),
            solimpfriction="0.9999 0.9999 0.001 0.5 2",
            solreffriction="0.004 1",
        )
        self.home.append(numbers([joint.position]))

    def _mass(self, body: Element, node: BodyNode) -> None:
        inertia = node.inertia
        _add(
            body,
            "inertial",
            pos=numbers(inertia.centre),
            mass=numbers([inertia.mass_kg]),
            fullinertia=numbers(inertia.moments),
        )

    def _geom(self, body: Element, geom: Geom, mass: float = 0.0) -> None:
        """A geom of an object of `mass` [kg], or of the static scene."""
        if isinstance(geom.shape, Mesh):
            self._visual(body, geom, geom.shape)
        elif isinstance(geom.shape, Box):
            place = geom.pose.matrix
            more = {"pos": numbers(place[:3, 3]), "size": numbers(geom.shape.half_size), **_turn(place[:3, :3])}
            _add(body, "geom", {"class": "collision"}, name=geom.label, type="box", **more, **_contact(geom, mass))
        else:
            vertices, faces = convex.surface(geom.vertices())
            self.files[f"assets/{geom.label}.obj"] = obj.text(Mesh(vertices=vertices, faces=faces)).encode()
            _add(self.asset, "mesh", name=geom.label, file=f"{geom.label}.obj")
            own = {"name": geom.label, "type": "mesh", "mesh": geom.label}
            _add(body, "geom", {"class": "collision"}, **own, **_contact(geom, mass))

    def _visual(self, body: Element, geom: Geom, mesh: Mesh) -> None:
        name, look = geom.label, geom.material
        moved = mesh.model_copy(update={"vertices": geom.vertices().astype(np.float32)})
        self.files[f"assets/{name}.obj"] = obj.text(moved).encode()
        _add(self.asset, "mesh", {"class": "visual"}, name=name, file=f"{name}.obj")
        gloss = numbers([look.gloss if look else 0.0])
        material = _add(self.asset, "material", name=name, specular=gloss, shininess=gloss)
        if mesh.texture is None:
            material.set("rgba", numbers((*mesh.colour, 1.0)))
        else:
            material.set("texture", self._texture(name, png(mesh.texture.pixels)))
        if look is not None and look.unlit:
            # MuJoCo adds emission and lit colour, and both are proportional to `rgba`: a dark material that glows.
            material.set("rgba", numbers((*np.full(3, LIT), 1.0)))
            material.set("emission", numbers([(1.0 - LIT * LIGHTS) / LIT]))
        _add(body, "geom", {"class": "visual"}, name=f"{name}_visual", mesh=name, material=name)

    def _texture(self, name: str, data: bytes) -> str:
        key = digest.of_bytes(data)
        if key not in self.textures:
            self.textures[key] = name
            self.files[f"assets/{name}.png"] = data
            _add(self.asset, "texture", name=name, type="2d", file=f"{name}.png")
        return self.textures[key]


def _turn(turn: np.ndarray) -> dict[str, str]:
    """Rotation of a geom; rotations about the vertical are written as a readable angle."""
    if turn[2, 2] == 1:
        return {"euler": numbers((0.0, 0.0, np.arctan2(turn[1, 0], turn[0, 0])))}
    return {"quat": numbers(quaternions.from_matrix(turn))}


def _solref(contact: Contact, mass: float) -> tuple[float, float]:
    return mjcf_contact.solref(contact.restitution, contact.stiffness_n_m, mass)


def _contact(geom: Geom, mass: float) -> dict[str, str]:
    """Contact parameters of an object, which take precedence over those of the static scene."""
    if geom.contact is None:
        return {}
    return {
        "friction": numbers(mjcf_contact.friction(geom.contact.friction)),
        "solref": numbers(_solref(geom.contact, mass)),
        "priority": "1",
    }


def _add(parent: Element, tag: str, extra: Mapping[str, str] | None = None, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, {**(extra or {}), **attributes})
