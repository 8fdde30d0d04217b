"""`Mesh` as USD: geometry and a UsdPreviewSurface, written to and read from stages."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.image import opened, png, rgb
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.formats import named_files, stage_files
from dextera_build.geometry import transforms
from dextera_build.geometry.baking import Part
from dextera_build.geometry.colour import to_linear, to_srgb

_PREVIEW = "UsdPreviewSurface"


def add_triangles(stage: Any, path: str, vertices: np.ndarray, faces: np.ndarray) -> Any:
    """Define a `UsdGeom.Mesh` of vertices (V, 3) and triangles (F, 3), not subdivided."""
    from pxr import UsdGeom, Vt

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(vertices, np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(faces.reshape(-1), np.int32)))
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    return mesh


def add_mesh(stage: Any, path: str, mesh: Mesh, origin: np.ndarray, material: str) -> None:
    """Add a visual mesh, translated from `origin` [m] to 0, with face-varying `st` if textured."""
    from pxr import Sdf, UsdGeom, UsdShade, Vt

    prim = add_triangles(stage, path, (mesh.vertices - origin).astype(np.float32), mesh.faces)
    if mesh.uv is not None:
        api = UsdGeom.PrimvarsAPI(prim)
        st = api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv.reshape(-1, 2), np.float32)))
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(UsdShade.Material.Get(stage, material))


def add_surface_material(
    stage: Any, path: str, colour: tuple[float, float, float], texture: str | None = None, roughness: float = 0.9
) -> str:
    """Add a UsdPreviewSurface: one sRGB `colour` 0..1, or the `texture` file, relative to the stage."""
    from pxr import Gf, Sdf, UsdShade

    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr(_PREVIEW)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    diffuse = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if texture is None:
        # Shader colours are linear, artifacts' colours are sRGB.
        diffuse.Set(Gf.Vec3f(*to_linear(np.array(colour)).tolist()))
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


def write(mesh: Mesh, path: Path) -> list[Path]:
    """Write a stage with z up, in metres, its default prim the mesh, and its texture next to it as `STEM.png`.

    A `.usdz` holds both.
    """
    if path.suffix.lower() == ".usdz":
        return stage_files.packed(path, lambda inner: write(mesh, inner))
    from pxr import Usd, UsdGeom

    path.unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Mesh").GetPrim())
    written = [path]
    if mesh.texture is not None:
        written.append(path.with_suffix(".png"))
        written[-1].write_bytes(png(mesh.texture.pixels))
    look = add_surface_material(stage, "/Mesh/Look", mesh.colour, written[1].name if len(written) > 1 else None)
    add_mesh(stage, "/Mesh/Surface", mesh, np.zeros(3), look)
    stage.GetRootLayer().Save()
    return written


def parts(path: Path, folder: Path) -> tuple[Iterator[Part], float, str]:
    """Every mesh of a stage in stage coordinates, as triangles; metres per unit; the up axis, `y` or `z`.

    Args:
        path: The file.
        folder: Folder with all layers and textures that it names.

    Raises:
        ValueError: The file is no stage, or damaged, its up axis is unknown, a face has fewer than three corners, or
            a layer or texture is missing.
        ArtifactError: It has too many prims.
    """
    stage = stage_files.opened(path, folder)
    unit, up = stage_files.units(stage)
    return _every(stage, path, folder), unit, up


def _every(stage: Any, path: Path, folder: Path) -> Iterator[Part]:
    from pxr import Tf, Usd, UsdGeom

    cache = UsdGeom.XformCache()
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.Mesh) and UsdGeom.Imageable(prim).ComputePurpose() != UsdGeom.Tokens.guide:
            placed = np.array(cache.GetLocalToWorldTransform(prim)).T
            try:
                yield from _parts(UsdGeom.Mesh(prim), placed, path, folder)
            except Tf.ErrorException as error:  # values of a binary file are unpacked only here
                raise ValueError(stage_files.said(error)) from None
            except (TypeError, IndexError, AttributeError):  # any attribute may hold a value of any type
                raise ValueError(f"an attribute of `{prim.GetPath()}` holds another type or count of values") from None


def _parts(mesh: Any, placed: np.ndarray, path: Path, folder: Path) -> Iterator[Part]:
    """One part per material: that of the whole mesh, or of each subset of its faces."""
    from pxr import UsdGeom, UsdShade

    points = np.array(mesh.GetPointsAttr().Get() or [], np.float64).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], np.int64)
    index = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], np.int64)
    if (counts < 3).any() or counts.sum() != len(index):
        raise ValueError(f"the faces of `{mesh.GetPath()}` are not whole")
    corners, owner = _fans(counts)
    turned = (mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded) != (np.linalg.det(placed[:3, :3]) < 0)
    if turned:
        corners = corners[:, ::-1]
    uv = _primvar(mesh, ("st", "st0", "UVMap"), index)
    shown = _primvar(mesh, ("displayColor",), index)
    vertices = transforms.apply(placed, points)
    rest = np.ones(len(corners), bool)
    subsets = UsdShade.MaterialBindingAPI(mesh.GetPrim()).GetMaterialBindSubsets()
    groups = [(np.isin(owner, np.array(each.GetIndicesAttr().Get())), each.GetPrim()) for each in subsets]
    for chosen, _ in groups:
        rest &= ~chosen
    for chosen, prim in [*groups, (rest, mesh.GetPrim())]:
        if chosen.any():
            colour, picture = _look(prim, path, folder)
            of = corners[chosen]
            yield Part(
                vertices,
                index[of],
                colour or Part.colour,
                None if uv is None else uv[of],
                picture,
                None if shown is None or colour is not None else to_srgb(shown[of]),
            )


def _fans(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (T, 3) into the list of corners of each polygon's triangles, and the polygon (T,) of each triangle."""
    starts = np.cumsum(counts) - counts
    owner = np.repeat(np.arange(len(counts)), counts - 2)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    first = starts[owner]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), owner


def _primvar(mesh: Any, names: tuple[str, ...], index: np.ndarray) -> np.ndarray | None:
    """Values of a primvar by corner (C, D), or None."""
    from pxr import UsdGeom

    api = UsdGeom.PrimvarsAPI(mesh)
    for name in names:
        primvar = api.GetPrimvar(name)
        found = primvar.ComputeFlattened() if primvar and primvar.HasValue() else None
        if found is None or not len(found):
            continue
        values, form = np.array(found, np.float64), primvar.GetInterpolation()
        if form == UsdGeom.Tokens.constant:
            return np.broadcast_to(values[0], (len(index), values.shape[1]))
        if form in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
            return np.asarray(values[index])
        if form == UsdGeom.Tokens.faceVarying:
            return values
    return None


def _look(prim: Any, path: Path, folder: Path) -> tuple[tuple[float, float, float] | None, np.ndarray | None]:
    """Colour (sRGB) and picture of the material bound to a prim, None if it has none."""
    from pxr import UsdShade

    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    source = shader.GetInput("diffuseColor") if shader and shader.GetIdAttr().Get() == _PREVIEW else None
    if not source:
        return None, None
    for attribute in source.GetValueProducingAttributes():
        of = UsdShade.Shader(attribute.GetPrim())
        if of.GetIdAttr().Get() == "UsdUVTexture" and of.GetInput("file"):
            return None, _picture(of.GetInput("file").Get(), path, folder)
    value = source.Get()
    red, green, blue = to_srgb(np.array(value if value is not None else (0.18, 0.18, 0.18), np.float64)).tolist()
    return (red, green, blue), None


def _picture(asset: Any, path: Path, folder: Path) -> np.ndarray:
    """Pixels of a texture, which may be inside a `.usdz`."""
    from pxr import Ar

    if asset.resolvedPath:
        named_files.found(stage_files.outer(asset.resolvedPath), path, folder)
    found = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath)) if asset.resolvedPath else None
    if found is None:
        raise ValueError(f"the texture `{asset.path}` is missing")
    return rgb(opened(bytes(found.GetBuffer()), asset.path))
