"""Write a twin as MJCF: pure functions from artifacts to the bytes of `scene.xml` and its files.

Visual geoms are group 2 without collision; collision geoms are group 3 convex pieces. Mass properties are always
explicit, because MuJoCo's estimate from meshes is wrong for thin and open ones. A link's body is at its joint's origin
with the object's axes; a root body is at the object's frame. Direction and limits of hinges are as in `Joint`;
keyframe `home` holds the pose in the photograph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree import ElementTree

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.geometry import Mesh, obj_text
from dextera_build.artifacts.image import png
from dextera_build.artifacts.object import Asset, Inertial, Joint
from dextera_build.artifacts.scene import Background
from dextera_build.geometry import convex, quaternions
from dextera_build.geometry.cameras import GL_FROM_CV
from dextera_build.sim.model import mjcf_contact, names

PIXEL_M = 1e-6
"""Nominal sensor pitch of the camera; only ratios matter [m]."""

Element = ElementTree.Element


def scene(assets: Mapping[str, Asset], background: Background, camera: Camera, world_from_camera: np.ndarray) -> Folder:
    """Write the MJCF of a complete twin.

    Args:
        assets: Label -> placed asset; the sanitized label is the root body's name.
        background: Static surface and boxes in the world frame.
        camera: Intrinsics of the photograph [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.

    Returns:
        `scene.xml` with `assets/*.obj` and `assets/*.png`; byte-identical for the same twin.
    """
    return _Writer(assets).folder(background, camera, world_from_camera)


def numbers(values: Sequence[float] | np.ndarray) -> str:
    """Format numbers as MJCF attributes: nine significant digits, no negative zero."""
    return " ".join(f"{float(value) + 0.0:.9g}" for value in values)


class _Writer:
    """Collects elements and files from the assets."""

    def __init__(self, assets: Mapping[str, Asset]) -> None:
        self.assets = assets
        self.names = names.link_names(assets)
        self.files: dict[str, bytes] = {}
        self.textures: dict[str, str] = {}
        self.home: list[str] = []
        self.root = Element("mujoco", model="twin")
        self.asset = Element("asset")
        self.contact = Element("contact")
        self.world = Element("worldbody")

    def folder(self, background: Background, camera: Camera, pose: np.ndarray) -> Folder:
        self._head(camera)
        self._view(camera, pose, background)
        self._background(background)
        for label in sorted(self.assets):
            self._object(label)
        self.root.extend([self.asset, self.world])
        if len(self.contact):
            self.root.append(self.contact)
        if self.home:
            keys = _add(self.root, "keyframe")
            _add(keys, "key", name="home", qpos=" ".join(self.home))
        ElementTree.indent(self.root, "  ")
        text = ElementTree.tostring(self.root, encoding="unicode") + "\n"
        return Folder(files={"scene.xml": text.encode(), **dict(sorted(self.files.items()))})

    def _head(self, camera: Camera) -> None:
        root = self.root
        _add(root, "compiler", angle="radian", meshdir="assets", texturedir="assets")
        # MuJoCo 4.0.0 diverges with sparse Jacobians; elliptic cones with a high impratio keep resting objects at rest.
        _add(root, "option", jacobian="dense", integrator="implicitfast", cone="elliptic", impratio="10")
        visual = _add(root, "visual")
        _add(visual, "global", offwidth=str(camera.width), offheight=str(camera.height))
        _add(visual, "quality", shadowsize="4096", offsamples="4")
        _add(visual, "headlight", ambient="0.45 0.45 0.45", diffuse="0.4 0.4 0.4", specular="0 0 0")
        _add(visual, "map", znear="0.01", zfar="50")
        places = [asset.pose.matrix[:3, 3] for asset in self.assets.values()]
        middle = np.mean(places, axis=0) if places else np.zeros(3)
        _add(root, "statistic", center=numbers(middle.round(3)), extent="1", meansize="0.05")
        defaults = _add(root, "default")
        looks = _add(defaults, "default", {"class": "visual"})
        _add(looks, "mesh", inertia="shell")
        _add(looks, "geom", type="mesh", group="2", contype="0", conaffinity="0", mass="0")
        solid = _add(defaults, "default", {"class": "collision"})
        _add(solid, "geom", group="3", condim="4", solref=numbers(mjcf_contact.solref(0.0)), rgba="0.3 0.6 0.9 0.4")

    def _view(self, camera: Camera, pose: np.ndarray, background: Background) -> None:
        # The image's mean colour, to keep the border of the static surface from glowing.
        sky = numbers((background.image.pixels.mean(axis=(0, 1)) / 255).round(3))
        _add(
            self.asset, "texture", name="sky", type="skybox", builtin="flat", rgb1=sky, rgb2=sky, width="8", height="48"
        )
        _add(
            self.world,
            "light",
            name="sun",
            type="directional",
            pos="0 0 3",
            dir="0.2 0.3 -1",
            diffuse="0.4 0.4 0.4",
            specular="0 0 0",
        )
        gl = pose @ GL_FROM_CV
        # The offset is from the image centre, half a pixel off the integer pixel centres; y is up since 3.6.
        offset = (camera.width / 2 - camera.cx - 0.5, camera.height / 2 - camera.cy - 0.5)
        _add(
            self.world,
            "camera",
            name="capture",
            pos=numbers(gl[:3, 3]),
            quat=numbers(quaternions.from_matrix(gl[:3, :3])),
            resolution=f"{camera.width} {camera.height}",
            sensorsize=numbers((camera.width * PIXEL_M, camera.height * PIXEL_M)),
            focalpixel=numbers((camera.fx, camera.fy)),
            principalpixel=numbers(offset),
        )

    def _background(self, background: Background) -> None:
        if len(background.mesh.faces):
            self._visual(self.world, "background", background.mesh, np.zeros(3))
        for box in background.boxes:
            _add(
                self.world,
                "geom",
                {"class": "collision"},
                name=f"static_{box.name}",
                type="box",
                pos=numbers(box.centre),
                size=numbers(box.half_size),
                euler=numbers((0.0, 0.0, box.yaw)),
            )

    def _object(self, label: str) -> None:
        asset = self.assets[label]
        self._link(self.world, label, names.root_link(asset.body), None, np.zeros(3))
        links = [self.names[label, link] for link in sorted(asset.body.links)]
        # Pieces of neighbouring links may overlap around the joint.
        for number, first in enumerate(links):
            for second in links[number + 1 :]:
                _add(self.contact, "exclude", body1=first, body2=second)

    def _link(self, parent: Element, label: str, link: str, joint: Joint | None, outer: np.ndarray) -> None:
        """Add a link's body and its descendants; `outer` is the parent's origin in the object frame [m]."""
        asset, name = self.assets[label], self.names[label, link]
        body = _add(parent, "body", name=name)
        origin = np.zeros(3)
        if joint is None:
            self._root(body, name, asset.pose.matrix)
        else:
            origin = np.asarray(joint.origin)
            body.set("pos", numbers(origin - outer))
            self._joint(body, f"{name}_{names.plain(joint.name)}", joint, asset)
        self._mass(body, asset.physics.links[link], origin)
        self._visual(body, name, asset.body.links[link].mesh, origin)
        self._pieces(body, name, link, asset, origin)
        for beyond in asset.body.joints:
            if beyond.parent == link:
                self._link(body, label, beyond.child, beyond, origin)

    def _root(self, body: Element, name: str, place: np.ndarray) -> None:
        position, turn = numbers(place[:3, 3]), numbers(quaternions.from_matrix(place[:3, :3]))
        body.set("pos", position)
        body.set("quat", turn)
        _add(body, "freejoint", name=name)
        self.home += [position, turn]

    def _joint(self, body: Element, name: str, joint: Joint, asset: Asset) -> None:
        dry, viscous = mjcf_contact.joint_friction(joint, asset.body, asset.physics)
        _add(
            body,
            "joint",
            name=name,
            type="hinge" if joint.type == "revolute" else "slide",
            axis=numbers(joint.axis),
            range=numbers((min(joint.lower, joint.position), max(joint.upper, joint.position))),
            limited="true",
            frictionloss=numbers([dry]),
            damping=numbers([viscous]),
            solimpfriction="0.9999 0.9999 0.001 0.5 2",
            solreffriction="0.004 1",
        )
        self.home.append(numbers([joint.position]))

    def _mass(self, body: Element, inertial: Inertial, origin: np.ndarray) -> None:
        _add(
            body,
            "inertial",
            pos=numbers(np.asarray(inertial.centre) - origin),
            mass=numbers([inertial.mass_kg]),
            fullinertia=numbers(inertial.inertia),
        )

    def _visual(self, body: Element, name: str, mesh: Mesh, origin: np.ndarray) -> None:
        moved = mesh.model_copy(update={"vertices": (mesh.vertices - origin).astype(np.float32)})
        self.files[f"assets/{name}.obj"] = obj_text(moved).encode()
        _add(self.asset, "mesh", {"class": "visual"}, name=name, file=f"{name}.obj")
        material = _add(self.asset, "material", name=name, specular="0", shininess="0")
        if mesh.texture is None:
            material.set("rgba", numbers((*mesh.colour, 1.0)))
        else:
            # The texture already contains the photograph's lighting: render it unlit.
            material.set("texture", self._texture(name, png(mesh.texture.pixels)))
            material.set("emission", "1")
        _add(body, "geom", {"class": "visual"}, name=f"{name}_visual", mesh=name, material=name)

    def _texture(self, name: str, data: bytes) -> str:
        key = digest.of_bytes(data)
        if key not in self.textures:
            self.textures[key] = name
            self.files[f"assets/{name}.png"] = data
            _add(self.asset, "texture", name=name, type="2d", file=f"{name}.png")
        return self.textures[key]

    def _pieces(self, body: Element, name: str, link: str, asset: Asset, origin: np.ndarray) -> None:
        physics = asset.physics
        for number, hull in enumerate(asset.collision.links[link].hulls):
            vertices, faces = convex.surface(hull.vertices - origin)
            piece = f"{name}_collision_{number}"
            self.files[f"assets/{piece}.obj"] = obj_text(Mesh(vertices=vertices, faces=faces)).encode()
            _add(self.asset, "mesh", name=piece, file=f"{piece}.obj")
            _add(
                body,
                "geom",
                {"class": "collision"},
                name=piece,
                type="mesh",
                mesh=piece,
                friction=numbers(mjcf_contact.friction(physics)),
                solref=numbers(mjcf_contact.solref(physics.restitution)),
                priority="1",
            )


def _add(parent: Element, tag: str, extra: Mapping[str, str] | None = None, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, {**(extra or {}), **attributes})
