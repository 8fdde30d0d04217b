"""Write a scene description as USD with UsdPhysics: Z up, metres, kilograms; textures alongside, paths relative.

    /World                      assembly
      PhysicsScene, Capture     gravity; the photograph's camera
      Lights                    see `sim.usd.lights`
      background                component: Surface (visual), Boxes (colliders)
      <object>                  component, labelled with its name
        <link>                  rigid body with mass; Visual, Collision/piece_N (guide, convex hulls)
        Joints/<joint>          between sibling links
        Looks                   surface and physics materials
      <robot>                   articulation, see `sim.usd.robot`

A held object is no rigid body if it is one piece; otherwise Joints/held fixes its root to the world.

A link's body is placed as in MJCF: at its joint's origin with the object's axes, moved by the positions of the home
keyframe; joint angle 0 is `JointNode` position 0. UsdPhysics has no dry joint friction, so that it is written for PhysX
(`sim.usd.physx`); the drive of such a joint is its viscous damping. The display name of a body or joint is its name in
MJCF.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.scenes.scene_description import (
    BodyNode,
    Contact,
    Geom,
    JointNode,
    Material,
    ObjectNode,
    SceneDescription,
)
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import RuleError
from dextera_build.formats.mesh_usd import add_mesh, add_surface_material
from dextera_build.geometry import convex, transforms
from dextera_build.geometry.cameras import GL_FROM_CV
from dextera_build.sim.model import mjcf_contact, names
from dextera_build.sim.usd import physx
from dextera_build.sim.usd.lights import add_lights
from dextera_build.sim.usd.prims import (
    add_camera,
    add_contact,
    add_drive,
    add_label,
    add_mass,
    add_piece,
    bind_contact,
    connect,
    place,
)
from dextera_build.sim.usd.robot import add_robot

WHITE_NITS = 1500.0
"""Luminance of white that suits the exposure of Isaac Sim's viewport: that of a dome of intensity 2000 and colour 0.75,
as in Isaac Lab's tutorials [cd/m^2]."""


def write(description: SceneDescription, held: Collection[str] = (), white_nits: float = WHITE_NITS) -> Folder:
    """Write `scene.usda` and `textures/*.png` of a scene; byte-identical for the same scene.

    Args:
        description: The scene.
        held: Names of objects with a fixed root.
        white_nits: Luminance of a white level surface [cd/m^2]; 0: no lights.

    Raises:
        RuleError: A robot has a name that is taken, or a property that USD cannot represent.
    """
    from pxr import Gf, Kind, Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world).SetKind(Kind.Tokens.assembly)
    physics = UsdPhysics.Scene.Define(stage, "/World/PhysicsScene")
    physics.CreateGravityDirectionAttr(Gf.Vec3f(0, 0, -1))
    physics.CreateGravityMagnitudeAttr(mjcf_contact.GRAVITY)
    for node in description.cameras:
        add_camera(stage, f"/World/{node.label.capitalize()}", node.camera, node.pose.matrix @ GL_FROM_CV)
    if white_nits:
        add_lights(stage, "/World/Lights", description.lights, white_nits, "/World/background")
    files: dict[str, bytes] = {}
    _static(stage, description.static, files)
    for thing in description.objects:
        _object(stage, f"/World/{thing.label}", thing, files, thing.label in held)
    _separate(stage, description)
    for each in description.attachments:
        path = f"/World/{each.prefix.removesuffix('/')}"
        if stage.GetPrimAtPath(path):
            raise RuleError(f"a robot and something else are called `{each.prefix}`", code="DXB-B215")
        add_robot(stage, path, each)
    text: str = stage.GetRootLayer().ExportToString()
    return Folder(files={"scene.usda": text.encode(), **dict(sorted(files.items()))})


def _static(stage: Any, geoms: tuple[Geom, ...], files: dict[str, bytes]) -> None:
    from pxr import Kind, Usd, UsdGeom

    path = "/World/background"
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.component)
    for own, geom, mesh in _visuals(geoms, "Surface"):
        look = _look(stage, path, own.lower(), geom, mesh, files)
        _mesh(stage, f"{path}/{own}", geom, mesh, look)
        add_label(stage.GetPrimAtPath(f"{path}/{own}"), geom.label)
    UsdGeom.Scope.Define(stage, f"{path}/Boxes")
    contacts = _contacts(stage, path, geoms)
    for geom in geoms:
        if geom.role == "collision":
            own = names.plain(geom.label.removeprefix("static_"))
            _piece(stage, f"{path}/Boxes/{own}", geom, contacts)


def _visuals(geoms: tuple[Geom, ...], name: str) -> Iterator[tuple[str, Geom, Mesh]]:
    """Prim names `name`, `name_2`, ... of visual geometry."""
    number = 0
    for geom in geoms:
        if isinstance(geom.shape, Mesh):
            number += 1
            yield name if number == 1 else f"{name}_{number}", geom, geom.shape


def _object(stage: Any, path: str, thing: ObjectNode, files: dict[str, bytes], held: bool) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdPhysics

    top = UsdGeom.Xform.Define(stage, path)
    Usd.ModelAPI(top).SetKind(Kind.Tokens.component)
    add_label(top.GetPrim(), thing.label)
    UsdGeom.Scope.Define(stage, f"{path}/Looks")
    geoms = [geom for part in sorted(thing.links) for geom in thing.links[part].geoms]
    contacts = _contacts(stage, path, geoms, thing.mass_kg)
    poses = thing.world_poses()
    for part in sorted(thing.links):
        _link(stage, path, part, thing.links[part], poses[part], files, contacts, bool(thing.joints) or not held)
    if thing.joints:
        UsdGeom.Scope.Define(stage, f"{path}/Joints")
        root = f"{path}/{names.plain(thing.root)}"
        first = stage.GetPrimAtPath(root)
        if held:
            fixed = UsdPhysics.FixedJoint.Define(stage, f"{path}/Joints/held")
            connect(fixed, ("", root), (poses[thing.root], np.eye(4)))
            first = fixed.GetPrim()
        physx.add_articulation(first)
    for joint in thing.joints:
        _joint(stage, path, joint, thing.origin(joint.parent), f"{thing.links[joint.child].label}_")


def _link(
    stage: Any,
    path: str,
    part: str,
    node: BodyNode,
    pose: np.ndarray,
    files: dict[str, bytes],
    contacts: dict[Contact | None, Any],
    moves: bool,
) -> None:
    from pxr import UsdGeom, UsdPhysics

    own = f"{path}/{names.plain(part)}"
    body = UsdGeom.Xform.Define(stage, own)
    place(body, pose)
    if moves:
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        body.GetPrim().SetDisplayName(node.label)
        xx, yy, zz, xy, xz, yz = node.inertia.moments
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        add_mass(body.GetPrim(), node.inertia.mass_kg, node.inertia.centre, inertia)
    for name, geom, mesh in _visuals(node.geoms, "Visual"):
        look = _look(stage, path, f"{names.plain(part)}{name.removeprefix('Visual')}", geom, mesh, files)
        _mesh(stage, f"{own}/{name}", geom, mesh, look)
    UsdGeom.Scope.Define(stage, f"{own}/Collision")
    solid = [geom for geom in node.geoms if geom.role == "collision"]
    for number, geom in enumerate(solid):
        _piece(stage, f"{own}/Collision/piece_{number}", geom, contacts)


def _piece(stage: Any, path: str, geom: Geom, contacts: dict[Contact | None, Any]) -> None:
    from pxr import UsdPhysics

    piece = add_piece(stage, path, *convex.surface(geom.vertices()))
    piece.SetDisplayName(geom.label)
    UsdPhysics.CollisionAPI.Apply(piece)
    bind_contact(piece, contacts[geom.contact])


def _contacts(stage: Any, path: str, geoms: Sequence[Geom], mass: float = 0.0) -> dict[Contact | None, Any]:
    """Physics materials `contact`, `contact_2`, ...; a surface without its own contact parameters takes the other's."""
    different = dict.fromkeys(geom.contact for geom in geoms if geom.role == "collision")
    return {
        contact: add_contact(
            stage,
            f"{path}/Looks/contact{f'_{number}' if number > 1 else ''}",
            0.0 if contact is None else contact.friction,
            0.0 if contact is None else contact.restitution,
            None if contact is None else mjcf_contact.spring(contact.restitution, contact.stiffness_n_m, mass),
        )
        for number, contact in enumerate(different, start=1)
    }


def _separate(stage: Any, description: SceneDescription) -> None:
    """Filter pairs of bodies that never touch; if some of their geoms may, all other pairs of geoms instead."""
    from pxr import Sdf, UsdPhysics

    shown = {prim.GetDisplayName(): prim for prim in stage.Traverse() if prim.GetDisplayName()}
    parts = {body.label: body for thing in description.objects for body in thing.links.values()}
    own = {label: [geom.label for geom in body.geoms if geom.role == "collision"] for label, body in parts.items()}
    allowed = {frozenset(pair) for pair in description.touch}
    for pair in description.exclude:
        single = [(one, other) for one in own[pair[0]] for other in own[pair[1]]]
        apart = [each for each in single if frozenset(each) not in allowed]
        for one, other in [pair] if len(apart) == len(single) else apart:
            if one in shown and other in shown:
                api = UsdPhysics.FilteredPairsAPI.Apply(shown[one])
                api.CreateFilteredPairsRel().AddTarget(Sdf.Path(shown[other].GetPath()))


def _mesh(stage: Any, path: str, geom: Geom, mesh: Mesh, look: str) -> None:
    moved = mesh.model_copy(update={"vertices": geom.vertices().astype(np.float32)})
    add_mesh(stage, path, moved, np.zeros(3), look)


def _look(stage: Any, path: str, own: str, geom: Geom, mesh: Mesh, files: dict[str, bytes]) -> str:
    """Write the material of a visual geom below `path` and return its prim path."""
    from pxr import UsdGeom

    UsdGeom.Scope.Define(stage, f"{path}/Looks")
    texture = None
    if mesh.texture is not None:
        texture = f"textures/{geom.label}.png"
        files[texture] = png(mesh.texture.pixels)
    roughness = (geom.material or Material()).roughness
    return add_surface_material(stage, f"{path}/Looks/{own}", mesh.colour, texture, roughness)


def _joint(stage: Any, path: str, joint: JointNode, outer: np.ndarray, prefix: str) -> None:
    """Write a joint with x along its axis; `outer` is the parent's origin in the object frame [m]."""
    from pxr import UsdPhysics

    turns = joint.type == "revolute"
    kind = UsdPhysics.RevoluteJoint if turns else UsdPhysics.PrismaticJoint
    prim = kind.Define(stage, f"{path}/Joints/{names.plain(joint.name)}")
    prim.GetPrim().SetDisplayName(prefix + names.plain(joint.name))
    along = transforms.rotation_between(np.array([1.0, 0.0, 0.0]), np.asarray(joint.axis))
    bodies = (f"{path}/{names.plain(joint.parent)}", f"{path}/{names.plain(joint.child)}")
    frames = (transforms.rigid(along, np.asarray(joint.origin) - outer), transforms.rigid(along, np.zeros(3)))
    connect(prim, bodies, frames)
    prim.CreateAxisAttr("X")
    prim.CreateLowerLimitAttr(joint.lower * physx.unit(turns))
    prim.CreateUpperLimitAttr(joint.upper * physx.unit(turns))
    # Pairs that are not filtered may touch, as in MJCF.
    prim.CreateCollisionEnabledAttr(True)
    add_drive(prim.GetPrim(), turns, joint.position, 0.0, joint.damping)
    physx.set_joint(prim.GetPrim(), turns, joint.friction, 0.0)
    physx.set_position(prim.GetPrim(), turns, joint.position)
