"""Write a twin as USD with UsdPhysics: Z up, metres, kilograms; textures alongside, all paths relative.

    /World                      assembly
      PhysicsScene, Capture     gravity; the photograph's camera
      background                component: Surface (visual), Boxes (colliders)
      <object>                  component
        <link>                  rigid body with mass; Visual, Collision/piece_N (guide, convex hulls)
        Joints/<joint>          between sibling links
        Looks                   surface and physics materials

A link's body is placed as in MJCF: at its joint's origin with the object's axes, moved by the observed joint positions;
joint angle 0 is `Joint` position 0. USD has no dry joint friction: a drive holds the observed position with at most the
friction torque of the MJCF joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.image import png
from dextera_build.artifacts.mesh_usd import add_mesh, add_surface_material
from dextera_build.artifacts.object import Asset, Inertial, Joint
from dextera_build.artifacts.scene import Background
from dextera_build.geometry import convex, kinematics, quaternions, transforms
from dextera_build.geometry.cameras import GL_FROM_CV
from dextera_build.sim.model import mjcf_contact, names
from dextera_build.sim.usd.prims import (
    add_camera,
    add_piece,
    bind_physics,
    box_points,
    place,
)

SAG_RAD = 0.01
"""Maximum deflection of a held joint by gravity from its observed position [rad]."""


def scene(assets: Mapping[str, Asset], background: Background, camera: Camera, world_from_camera: np.ndarray) -> Folder:
    """Write `scene.usda` and `textures/*.png` of a complete twin; byte-identical for the same twin.

    Args:
        assets: Label -> placed asset.
        background: Static surface and boxes in the world frame.
        camera: Intrinsics of the photograph [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
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
    add_camera(stage, "/World/Capture", camera, world_from_camera @ GL_FROM_CV)
    files: dict[str, bytes] = {}
    _background(stage, background, files)
    link_names = names.link_names(assets)
    for label in sorted(assets):
        _object(stage, assets[label], {link: link_names[label, link] for link in assets[label].body.links}, files)
    text: str = stage.GetRootLayer().ExportToString()
    return Folder(files={"scene.usda": text.encode(), **dict(sorted(files.items()))})


def _background(stage: Any, background: Background, files: dict[str, bytes]) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdPhysics

    path = "/World/background"
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.component)
    if len(background.mesh.faces):
        look = _look(stage, path, "surface", "background", background.mesh, files)
        add_mesh(stage, f"{path}/Surface", background.mesh, np.zeros(3), look)
    UsdGeom.Scope.Define(stage, f"{path}/Boxes")
    for box in background.boxes:
        points = box_points(box)
        prim = add_piece(stage, f"{path}/Boxes/{names.plain(box.name)}", *convex.surface(points))
        UsdPhysics.CollisionAPI.Apply(prim)


def _object(stage: Any, asset: Asset, link_names: dict[str, str], files: dict[str, bytes]) -> None:
    from pxr import Kind, Usd, UsdGeom, UsdPhysics

    root = names.root_link(asset.body)
    path = f"/World/{link_names[root]}"
    Usd.ModelAPI(UsdGeom.Xform.Define(stage, path)).SetKind(Kind.Tokens.component)
    incoming = {joint.child: joint for joint in asset.body.joints}
    poses = kinematics.link_poses(asset.body)
    UsdGeom.Scope.Define(stage, f"{path}/Looks")
    contact = f"{path}/Looks/contact"
    bind = bind_physics(stage, contact, asset.physics)
    for link in sorted(asset.body.links):
        origin = np.asarray(incoming[link].origin) if link in incoming else np.zeros(3)
        frame = transforms.rigid(np.eye(3), origin)
        own = f"{path}/{names.plain(link)}"
        body = UsdGeom.Xform.Define(stage, own)
        place(body, asset.pose.matrix @ poses[link] @ frame)
        UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
        _mass(body.GetPrim(), asset.physics.links[link], origin)
        mesh = asset.body.links[link].mesh
        look = _look(stage, path, names.plain(link), link_names[link], mesh, files)
        add_mesh(stage, f"{own}/Visual", mesh, origin, look)
        UsdGeom.Scope.Define(stage, f"{own}/Collision")
        for number, hull in enumerate(asset.collision.links[link].hulls):
            piece = add_piece(stage, f"{own}/Collision/piece_{number}", *convex.surface(hull.vertices - origin))
            UsdPhysics.CollisionAPI.Apply(piece)
            bind(piece)
    if asset.body.joints:
        UsdPhysics.ArticulationRootAPI.Apply(stage.GetPrimAtPath(f"{path}/{names.plain(root)}"))
        UsdGeom.Scope.Define(stage, f"{path}/Joints")
    for joint in asset.body.joints:
        outer = np.asarray(incoming[joint.parent].origin) if joint.parent in incoming else np.zeros(3)
        _joint(stage, path, joint, outer, asset)


def _look(stage: Any, path: str, own: str, file: str, mesh: Any, files: dict[str, bytes]) -> str:
    """Write the mesh's material below `path` and return its prim path."""
    from pxr import UsdGeom

    UsdGeom.Scope.Define(stage, f"{path}/Looks")
    texture = None
    if mesh.texture is not None:
        texture = f"textures/{file}.png"
        files[texture] = png(mesh.texture.pixels)
    return add_surface_material(stage, f"{path}/Looks/{own}", mesh.colour, texture)


def _mass(prim: Any, inertial: Inertial, origin: np.ndarray) -> None:
    from pxr import Gf, UsdPhysics

    xx, yy, zz, xy, xz, yz = inertial.inertia
    moments, axes = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    api = UsdPhysics.MassAPI.Apply(prim)
    api.CreateMassAttr(inertial.mass_kg)
    api.CreateCenterOfMassAttr(Gf.Vec3f(*(np.asarray(inertial.centre) - origin).tolist()))
    api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
    api.CreatePrincipalAxesAttr(Gf.Quatf(*quaternions.from_matrix(axes).tolist()))


def _joint(stage: Any, path: str, joint: Joint, outer: np.ndarray, asset: Asset) -> None:
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
    prim.CreateLowerLimitAttr(min(joint.lower, joint.position) * unit)
    prim.CreateUpperLimitAttr(max(joint.upper, joint.position) * unit)
    dry, viscous = mjcf_contact.joint_friction(joint, asset.body, asset.physics)
    drive = UsdPhysics.DriveAPI.Apply(prim.GetPrim(), "angular" if turns else "linear")
    drive.CreateTypeAttr("force")
    drive.CreateTargetPositionAttr(joint.position * unit)
    drive.CreateStiffnessAttr(dry / SAG_RAD / unit)
    drive.CreateDampingAttr(viscous / unit)
    drive.CreateMaxForceAttr(dry)
