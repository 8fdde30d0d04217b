"""Conversion of placed assets, their background and the photograph's camera to a `SceneDescription`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Asset, Joint
from dextera_build.artifacts.scenes.scene import Background, SupportBox
from dextera_build.artifacts.scenes.scene_description import (
    BodyNode,
    Box,
    CameraNode,
    Contact,
    Geom,
    Inertia,
    JointNode,
    Light,
    Material,
    ObjectNode,
    SceneDescription,
)
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import lie, transforms
from dextera_build.sim.model import completeness, mjcf_contact, names, neighbours, touching

SUN = Light(label="sun", direction=(0.2, 0.3, -1.0), place=(0.0, 0.0, 1.5), diffuse=(0.4, 0.4, 0.4))
"""The light of every twin. It is below the ceiling of a closed room, whose shadow would fall on everything."""


def describe(
    found: neighbours.Parted, background: Background, camera: Camera, world_from_camera: np.ndarray
) -> SceneDescription:
    """The complete twin in the world frame: every asset a free object, the background static.

    Args:
        found: Placed assets from `parted`; the sanitized label is the object's name.
        background: Static surface and boxes in the world frame.
        camera: Intrinsics of the photograph [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
    """
    assets = found.assets
    link_names = names.link_names(assets)
    objects: list[ObjectNode] = []
    exclude: list[tuple[str, str]] = []
    touch: list[tuple[str, str]] = []
    for label in sorted(assets):
        own = {link: link_names[label, link] for link in sorted(assets[label].body.links)}
        objects.append(_object(assets[label], own))
        # Pieces of neighbouring links may overlap around the joint.
        parts = list(own.values())
        exclude += [(first, second) for number, first in enumerate(parts) for second in parts[number + 1 :]]
        touch += [(_piece(own[a], i), _piece(own[b], j)) for (a, i), (b, j) in touching.pieces(assets[label])]
    red, green, blue = (background.image.pixels.mean(axis=(0, 1)) / 255).tolist()
    pose = Pose(parent="world", child="camera", matrix=np.array(world_from_camera, np.float64))
    return SceneDescription(
        objects=tuple(objects),
        static=_static(background),
        cameras=(CameraNode(label="capture", camera=camera, pose=pose),),
        lights=(SUN,),
        # The image's mean colour, to keep the border of the static surface from glowing.
        backdrop=(red, green, blue),
        exclude=tuple(exclude),
        touch=tuple(touch),
    )


def parted(assets: Mapping[str, Asset], background: Background) -> neighbours.Parted:
    """The assets with collision pieces that overlap neither one another nor the background's, and that do not hover.

    See `neighbours`.

    Raises:
        RuleError: A link of an asset has no collision pieces or no mass.
    """
    completeness.check(assets)
    return neighbours.parted(assets, [_support(box).vertices() for box in background.boxes])


def _piece(body: str, number: int) -> str:
    return f"{body}_collision_{number}"


def _object(asset: Asset, own: Mapping[str, str]) -> ObjectNode:
    origins = {joint.child: np.asarray(joint.origin) for joint in asset.body.joints}
    links = {link: _body(asset, link, name, origins.get(link, np.zeros(3))) for link, name in own.items()}
    return ObjectNode(pose=asset.pose, links=links, joints=tuple(_joint(joint, asset) for joint in asset.body.joints))


def _body(asset: Asset, link: str, name: str, origin: np.ndarray) -> BodyNode:
    """A link; `origin` is that of its frame in the object frame, in which the geometry of assets is stored [m]."""
    physics = asset.physics
    inertial = physics.links[link]
    x, y, z = (np.asarray(inertial.centre) - origin).tolist()
    pose = _placed(transforms.rigid(np.eye(3), -origin))
    contact = Contact(friction=physics.friction, restitution=physics.restitution, stiffness_n_m=physics.stiffness_n_m)
    pieces = (
        Geom(label=_piece(name, number), role="collision", shape=hull, pose=pose, contact=contact)
        for number, hull in enumerate(asset.collision.links[link].hulls)
    )
    return BodyNode(
        label=name,
        inertia=Inertia(mass_kg=inertial.mass_kg, centre=(x, y, z), moments=inertial.inertia),
        geoms=(_visual(name, asset.body.links[link].mesh, pose), *pieces),
    )


def _joint(joint: Joint, asset: Asset) -> JointNode:
    down = -asset.pose.matrix[2, :3]
    friction, damping = mjcf_contact.joint_friction(joint, asset.body, asset.physics, down)
    return JointNode(
        name=joint.name,
        type=joint.type,
        parent=joint.parent,
        child=joint.child,
        origin=joint.origin,
        axis=joint.axis,
        lower=min(joint.lower, joint.position),
        upper=max(joint.upper, joint.position),
        position=joint.position,
        friction=friction,
        damping=damping,
    )


def _static(background: Background) -> tuple[Geom, ...]:
    meshes = {"background": background.mesh, "invented": background.invented}
    surfaces = [_visual(name, mesh, _placed(np.eye(4))) for name, mesh in meshes.items() if mesh and len(mesh.faces)]
    return (*surfaces, *map(_support, background.boxes))


def _support(box: SupportBox) -> Geom:
    pose = _placed(transforms.rigid(lie.about_z(box.yaw), np.asarray(box.centre)))
    return Geom(
        label=f"static_{names.plain(box.name)}", role="collision", shape=Box(half_size=box.half_size), pose=pose
    )


def _visual(name: str, mesh: Mesh, pose: Pose) -> Geom:
    # The texture already contains the photograph's lighting.
    return Geom(label=name, role="visual", shape=mesh, pose=pose, material=Material(unlit=mesh.texture is not None))


def _placed(matrix: np.ndarray) -> Pose:
    return Pose(parent="body", child="geom", matrix=matrix)
