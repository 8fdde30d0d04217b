"""Single USD prims of a scene: convex pieces, physics materials, the camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.mesh_usd import add_triangles
from dextera_build.artifacts.scene_description import Contact
from dextera_build.geometry import quaternions

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


def add_contact(stage: Any, path: str, contact: Contact) -> Any:
    """Write a physics material at `path`."""
    from pxr import UsdPhysics, UsdShade

    material = UsdShade.Material.Define(stage, path)
    api = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    api.CreateStaticFrictionAttr(contact.friction)
    api.CreateDynamicFrictionAttr(contact.friction)
    api.CreateRestitutionAttr(contact.restitution)
    return material


def bind_contact(prim: Any, material: Any) -> None:
    """Let a collider touch others as a physics material says."""
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
