"""Single USD prims of a scene: convex pieces, physics materials, masses, joints, drives, labels, the camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.formats.mesh_usd import add_triangles
from dextera_build.geometry import quaternions
from dextera_build.sim.usd import physx

APERTURE = 0.36
"""Width of the nominal sensor in tenths of a metre, USD's unit; only ratios matter."""


def place(prim: Any, pose: np.ndarray) -> None:
    """Give a `UsdGeom.Xformable` the rigid (4, 4) `pose`: translation and orientation, no scale."""
    from pxr import Gf, UsdGeom

    prim.AddTranslateOp().Set(Gf.Vec3d(*pose[:3, 3].tolist()))
    turn = quaternions.from_matrix(pose[:3, :3])
    prim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(*turn.tolist()))


def add_piece(stage: Any, path: str, vertices: np.ndarray, faces: np.ndarray) -> Any:
    """Add a convex collision piece, hidden as a guide; the caller adds the collision API."""
    from pxr import UsdGeom, UsdPhysics

    mesh = add_triangles(stage, path, vertices, faces)
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    return mesh.GetPrim()


def add_mass(prim: Any, mass: float, centre: Sequence[float], inertia: np.ndarray) -> None:
    """Write mass [kg], centre of mass [m] and inertia (3, 3) about it [kg m^2] of a rigid body, in its frame."""
    from pxr import Gf, UsdPhysics

    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 0] = -axes[:, 0]
    api = UsdPhysics.MassAPI.Apply(prim)
    api.CreateMassAttr(mass)
    api.CreateCenterOfMassAttr(Gf.Vec3f(*map(float, centre)))
    api.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
    api.CreatePrincipalAxesAttr(Gf.Quatf(*quaternions.from_matrix(axes).tolist()))


def connect(
    joint: Any,
    bodies: tuple[str, str],
    poses: tuple[np.ndarray, np.ndarray],
) -> None:
    """Connect two prims by a joint with its frame at `poses` (4, 4) in them; an empty path is the world."""
    from pxr import Gf, Sdf

    relations = (joint.CreateBody0Rel, joint.CreateBody1Rel)
    places = (joint.CreateLocalPos0Attr, joint.CreateLocalPos1Attr)
    turns = (joint.CreateLocalRot0Attr, joint.CreateLocalRot1Attr)
    for path, pose, relation, place_of, turn_of in zip(bodies, poses, relations, places, turns, strict=True):
        if path:
            relation().SetTargets([Sdf.Path(path)])
        place_of(Gf.Vec3f(*pose[:3, 3].tolist()))
        turn_of(Gf.Quatf(*quaternions.from_matrix(pose[:3, :3]).tolist()))


def add_drive(
    prim: Any, turns: bool, target: float, stiffness: float, damping: float, effort: float | None = None
) -> None:
    """Write a position drive, in rad, N m or m, N; without stiffness it is a damper."""
    from pxr import UsdPhysics

    drive = UsdPhysics.DriveAPI.Apply(prim, "angular" if turns else "linear")
    drive.CreateTypeAttr("force")
    drive.CreateTargetPositionAttr(target * physx.unit(turns))
    drive.CreateStiffnessAttr(stiffness / physx.unit(turns))
    drive.CreateDampingAttr(damping / physx.unit(turns))
    if effort is not None:
        drive.CreateMaxForceAttr(effort)


def add_label(prim: Any, label: str) -> None:
    """Label a prim and its descendants; Isaac's annotators read the label as `class`."""
    from pxr import UsdSemantics

    UsdSemantics.LabelsAPI.Apply(prim, "class").CreateLabelsAttr([label])


def add_contact(
    stage: Any, path: str, friction: float, restitution: float, spring: tuple[float, float] | None = None
) -> Any:
    """Write a physics material at `path`; of two in contact, the larger values apply.

    Args:
        stage: The stage.
        path: Path of the material.
        friction: Static and dynamic friction.
        restitution: Coefficient of restitution.
        spring: Stiffness [N/m] and damping [N s/m] of a soft surface; None: rigid.
    """
    from pxr import UsdPhysics, UsdShade

    material = UsdShade.Material.Define(stage, path)
    api = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    api.CreateStaticFrictionAttr(friction)
    api.CreateDynamicFrictionAttr(friction)
    api.CreateRestitutionAttr(restitution)
    physx.set_material(material.GetPrim(), spring)
    return material


def bind_contact(prim: Any, material: Any) -> None:
    """Bind a physics material to a collider."""
    from pxr import UsdShade

    binding = UsdShade.MaterialBindingAPI.Apply(prim)
    binding.Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")


def add_camera(stage: Any, path: str, camera: Camera, pose: np.ndarray) -> None:
    """Add the photograph's camera at `pose` (4, 4), OpenGL axes; aperture offsets encode the principal point."""
    from pxr import Gf, UsdGeom

    focal = APERTURE * camera.fx / camera.width
    prim = UsdGeom.Camera.Define(stage, path)
    place(prim, pose)
    prim.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    prim.CreateFocalLengthAttr(focal)
    prim.CreateHorizontalApertureAttr(APERTURE)
    prim.CreateVerticalApertureAttr(camera.height * focal / camera.fy)
    # Integer pixel centres: the image centre is pixel (W - 1) / 2.
    prim.CreateHorizontalApertureOffsetAttr(((camera.width - 1) / 2 - camera.cx) * focal / camera.fx)
    prim.CreateVerticalApertureOffsetAttr((camera.cy - (camera.height - 1) / 2) * focal / camera.fy)
    prim.CreateClippingRangeAttr(Gf.Vec2f(0.01, 100.0))
