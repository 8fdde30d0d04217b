"""Write a scene description as USD with UsdPhysics: Z up, metres, kilograms; textures alongside, paths relative.

    /World                      assembly
      PhysicsScene, Capture     gravity; the photograph's camera
      background                component: Surface (visual), Boxes (colliders)
      <object>                  component
        <link>                  rigid body with mass; Visual, Collision/piece_N (guide, convex hulls)
        Joints/<joint>          between sibling links
        Looks                   surface and physics materials

A held object is no rigid body if it is one piece; otherwise Joints/held fixes its root to the world.

A link's body is placed as in MJCF: at its joint's origin with the object's axes, moved by the positions of the home
keyframe; joint angle 0 is `JointNode` position 0. USD has no dry joint friction: a drive holds the home position with
at most the friction torque of the MJCF joint. Lights are left to the viewer, as textures have that of the photograph.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.geometry import Mesh
from dextera_build.artifacts.image import png
from dextera_build.artifacts.mesh_usd import add_mesh, add_surface_material
from dextera_build.artifacts.object import Asset
from dextera_build.artifacts.scene import Background
from dextera_build.artifacts.scene_description import (
    Contact,
    Geom,
    Inertia,
    JointNode,
    Material,
    ObjectNode,
    SceneDescription,
)
from dextera_build.errors import RuleError
from dextera_build.geometry import convex, quaternions, transforms
from dextera_build.geometry.cameras import GL_FROM_CV
from dextera_build.sim.model import mjcf_contact, names
from dextera_build.sim.model.description import describe
from dextera_build.sim.usd.prims import add_camera, add_contact, add_piece, bind_contact, place

SAG_RAD = 0.01
"""Maximum deflection of a held joint by gravity from its observed position [rad]."""


def scene(
    assets: Mapping[str, Asset],
    background: Background,
    camera: Camera,
    world_from_camera: np.ndarray,
    held: Collection[str] = (),
) -> Folder:
    """Write the USD of a complete twin; the arguments are those of `describe` and `write`."""
    return write(describe(assets, background, camera, world_from_camera), held)


def write(description: SceneDescription, held: Collection[str] = ()) -> Folder:
    """Write `scene.usda` and `textures/*.png` of a scene; byte-identical for the same scene.

    Args:
        description: The scene.
        held: Names of objects whose root cannot move.

    Raises:
        RuleError: It has robots.
    """
    from pxr import Gf, Kind, Usd, UsdGeom, UsdPhysics

    if description.attachments:
        raise RuleError(
            "a scene with robots cannot be written as USD",
            code="DXB-B215",
            facts={"robots": ", ".join(each.prefix for each in description.attachments)},
            hint="write the scene without them, or as MJCF",
        )
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
    files: dict[str, bytes] = {}
    _static(stage, description.static, files)
    for thing in description.objects:
        _object(stage, f"/World/{thing.label}", thing, files, thing.label in held)
    text: str = stage.GetRootLayer().ExportToString()
    return Folder(files={"scene.usda": text.encode(), **dict(sorted(files.items()))})


def _static(stage: Any, geoms: tuple[Geom, ...], files: dict[str, bytes]) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdPhysics

    path = "/World/background"
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.component)
    for own, geom, mesh in _visuals(geoms, "Surface"):
        look = _look(stage, path, own.lower(), geom, mesh, files)
        _mesh(stage, f"{path}/{own}", geom, mesh, look)
    UsdGeom.Scope.Define(stage, f"{path}/Boxes")
    for geom in geoms:
        if geom.role == "collision":
            own = names.plain(geom.label.removeprefix("static_"))
            UsdPhysics.CollisionAPI.Apply(add_piece(stage, f"{path}/Boxes/{own}", *convex.surface(geom.vertices())))


def _visuals(geoms: tuple[Geom, ...], name: str) -> Iterator[tuple[str, Geom, Mesh]]:
    """Prim names `name`, `name_2`, ... of what is seen."""
    number = 0
    for geom in geoms:
        if isinstance(geom.shape, Mesh):
            number += 1
            yield name if number == 1 else f"{name}_{number}", geom, geom.shape


def _object(stage: Any, path: str, thing: ObjectNode, files: dict[str, bytes], held: bool) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdPhysics

    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.component)
    UsdGeom.Scope.Define(stage, f"{path}/Looks")
    contacts = _contacts(stage, path, thing)
    poses = thing.world_poses()
    for part in sorted(thing.links):
        node, own = thing.links[part], f"{path}/{names.plain(part)}"
        body = UsdGeom.Xform.Define(stage, own)
        place(body, poses[part])
        if thing.joints or not held:
            UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
            _mass(body.GetPrim(), node.inertia)
        for name, geom, mesh in _visuals(node.geoms, "Visual"):
            look = _look(stage, path, f"{names.plain(part)}{name.removeprefix('Visual')}", geom, mesh, files)
            _mesh(stage, f"{own}/{name}", geom, mesh, look)
        UsdGeom.Scope.Define(stage, f"{own}/Collision")
        solid = [geom for geom in node.geoms if geom.role == "collision"]
        for number, geom in enumerate(solid):
            piece = add_piece(stage, f"{own}/Collision/piece_{number}", *convex.surface(geom.vertices()))
            UsdPhysics.CollisionAPI.Apply(piece)
            if geom.contact is not None:
                bind_contact(piece, contacts[geom.contact])
    if thing.joints:
        UsdGeom.Scope.Define(stage, f"{path}/Joints")
        root = f"{path}/{names.plain(thing.root)}"
        first = _fixed(stage, f"{path}/Joints/held", root, poses[thing.root]) if held else stage.GetPrimAtPath(root)
        UsdPhysics.ArticulationRootAPI.Apply(first)
    for joint in thing.joints:
        _joint(stage, path, joint, thing.origin(joint.parent))


def _contacts(stage: Any, path: str, thing: ObjectNode) -> dict[Contact, Any]:
    """Physics materials `contact`, `contact_2`, ... of an object."""
    geoms = [geom for part in sorted(thing.links) for geom in thing.links[part].geoms]
    different = dict.fromkeys(geom.contact for geom in geoms if geom.contact is not None)
    return {
        contact: add_contact(stage, f"{path}/Looks/contact{f'_{number}' if number > 1 else ''}", contact)
        for number, contact in enumerate(different, start=1)
    }


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


def _mass(prim: Any, inertia: Inertia) -> None:
    from pxr import Gf, UsdPhysics

    xx, yy, zz, xy, xz, yz = inertia.moments
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    api = UsdPhysics.MassAPI.Apply(prim)
    api.CreateMassAttr(inertia.mass_kg)
    api.CreateCenterOfMassAttr(Gf.Vec3f(*inertia.centre))
    api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
    api.CreatePrincipalAxesAttr(Gf.Quatf(*quaternions.from_matrix(axes).tolist()))


def _fixed(stage: Any, path: str, root: str, pose: np.ndarray) -> Any:
    """Write the joint that fixes a body to the world at its `pose` (4, 4), and return its prim."""
    from pxr import Gf, Sdf, UsdPhysics

    prim = UsdPhysics.FixedJoint.Define(stage, path)
    prim.CreateBody1Rel().SetTargets([Sdf.Path(root)])
    prim.CreateLocalPos0Attr(Gf.Vec3f(*pose[:3, 3].tolist()))
    prim.CreateLocalRot0Attr(Gf.Quatf(*quaternions.from_matrix(pose[:3, :3]).tolist()))
    prim.CreateLocalPos1Attr(Gf.Vec3f(0.0, 0.0, 0.0))
    prim.CreateLocalRot1Attr(Gf.Quatf(1.0, 0.0, 0.0, 0.0))
    return prim.GetPrim()


def _joint(stage: Any, path: str, joint: JointNode, outer: np.ndarray) -> None:
    """Write a joint with x along its axis; `outer` is the parent's origin in the object frame [m]."""
    from pxr import Gf, Sdf, UsdPhysics

    turns = joint.type == "revolute"
    kind = UsdPhysics.RevoluteJoint if turns else UsdPhysics.PrismaticJoint
    prim = kind.Define(stage, f"{path}/Joints/{names.plain(joint.name)}")
    prim.CreateBody0Rel().SetTargets([Sdf.Path(f"{path}/{names.plain(joint.parent)}")])
    prim.CreateBody1Rel().SetTargets([Sdf.Path(f"{path}/{names.plain(joint.child)}")])
    turn = quaternions.from_matrix(transforms.rotation_between(np.array([1.0, 0.0, 0.0]), np.asarray(joint.axis)))
    prim.CreateLocalPos0Attr(Gf.Vec3f(*(np.asarray(joint.origin) - outer).tolist()))
    prim.CreateLocalPos1Attr(Gf.Vec3f(0.0, 0.0, 0.0))
    prim.CreateLocalRot0Attr(Gf.Quatf(*turn.tolist()))
    prim.CreateLocalRot1Attr(Gf.Quatf(*turn.tolist()))
    prim.CreateAxisAttr("X")
    unit = float(np.degrees(1.0)) if turns else 1.0
    prim.CreateLowerLimitAttr(joint.lower * unit)
    prim.CreateUpperLimitAttr(joint.upper * unit)
    drive = UsdPhysics.DriveAPI.Apply(prim.GetPrim(), "angular" if turns else "linear")
    drive.CreateTypeAttr("force")
    drive.CreateTargetPositionAttr(joint.position * unit)
    drive.CreateStiffnessAttr(joint.friction / SAG_RAD / unit)
    drive.CreateDampingAttr(joint.damping / unit)
    drive.CreateMaxForceAttr(joint.friction)
