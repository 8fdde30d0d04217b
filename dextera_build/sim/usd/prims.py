"""Single USD prims of a scene: convex pieces, physics materials, the camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.mesh_usd import add_triangles
from dextera_build.artifacts.object import Physics
from dextera_build.artifacts.scene import SupportBox
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


def bind_physics(stage: Any, path: str, physics: Physics) -> Callable[[Any], None]:
    """Write a physics material at `path` and return a function that binds it to a collider."""
    from pxr import UsdPhysics, UsdShade

    material = UsdShade.Material.Define(stage, path)
    api = UsdPhysics.MaterialAPI.Apply(material.GetPrim())
    api.CreateStaticFrictionAttr(physics.friction)
    api.CreateDynamicFrictionAttr(physics.friction)
    api.CreateRestitutionAttr(physics.restitution)

    def bind(prim: Any) -> None:
        binding = UsdShade.MaterialBindingAPI.Apply(prim)
        binding.Bind(material, UsdShade.Tokens.weakerThanDescendants, "physics")

    return bind


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


def box_points(box: SupportBox) -> np.ndarray:
    """Corners (8, 3) of a box in the world frame [m]."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    c, s = np.cos(box.yaw), np.sin(box.yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(signs * box.half_size @ turn.T + box.centre)
