"""Single USD prims: meshes, convex pieces, materials, the camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.geometry import Mesh
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


def add_mesh(stage: Any, path: str, mesh: Mesh, origin: np.ndarray, material: str) -> None:
    """Add a visual mesh, translated from `origin` [m] to 0, with face-varying `st` if textured."""
    from pxr import Sdf, UsdGeom, UsdShade, Vt

    prim = _triangles(stage, path, (mesh.vertices - origin).astype(np.float32), mesh.faces)
    if mesh.uv is not None:
        api = UsdGeom.PrimvarsAPI(prim)
        st = api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv.reshape(-1, 2), np.float32)))
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, material))


def add_piece(stage: Any, path: str, vertices: np.ndarray, faces: np.ndarray) -> Any:
    """Add a convex collision piece, hidden as a guide; the caller adds the collision API."""
    from pxr import UsdGeom, UsdPhysics

    mesh = _triangles(stage, path, vertices, faces)
    mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
    UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr(UsdPhysics.Tokens.convexHull)
    return mesh.GetPrim()


def add_surface_material(stage: Any, path: str, colour: tuple[float, float, float], texture: str | None = None) -> str:
    """Add a matte UsdPreviewSurface: one sRGB `colour` 0..1, or the `texture` file, relative to the stage."""
    from pxr import Gf, Sdf, UsdShade

    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.9)
    diffuse = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if texture is None:
        # Shader colours are linear, artifacts' colours are sRGB.
        diffuse.Set(Gf.Vec3f(*(_linear(c) for c in colour)))
    else:
        reader = UsdShade.Shader.Define(stage, f"{path}/St")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        image = UsdShade.Shader.Define(stage, f"{path}/Texture")
        image.CreateIdAttr("UsdUVTexture")
        image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(f"./{texture}"))
        image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        image.CreateInput("wrapS", Sdf.ValueTypeNames.Token).Set("clamp")
        image.CreateInput("wrapT", Sdf.ValueTypeNames.Token).Set("clamp")
        image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        diffuse.ConnectToSource(image.ConnectableAPI(), "rgb")
    shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    return path


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


def _triangles(stage: Any, path: str, vertices: np.ndarray, faces: np.ndarray) -> Any:
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.reshape(-1), np.int32)))
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    return mesh


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
