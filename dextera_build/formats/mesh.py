"""`Mesh` in the formats of other programs: GLB, OBJ, PLY, STL and USD."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dextera_build.artifacts.cameras.image import Image, opened, rgb
from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import listing
from dextera_build.formats import gltf, mesh_bounds, mesh_usd, named_files, obj
from dextera_build.formats.files import suffix_among
from dextera_build.geometry.baking import Part, joined
from dextera_build.geometry.colour import to_linear, to_srgb

LOADS = (".glb", ".obj", ".ply", ".stl", ".usda", ".usdc", ".usd", ".usdz")
"""Suffixes of files that `load` reads."""
_USD = (".usda", ".usdc", ".usd", ".usdz")
_SPLIT = (".glb", ".obj", ".stl")
"""Formats that duplicate vertices by texture coordinate or face."""
_UP = {
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "z": np.eye(3),
}
"""Up axis of a file -> rotation to z up."""
_MAP_OPTIONS = re.compile(r"^(?:-(?:[ost](?:\s+[-+.\deE]+){1,3}|mm\s+\S+\s+\S+|[a-zA-Z]+\s+\S+)\s+)+")
"""Options of a `map_Kd` before the name of the picture."""


def load(
    path: str | Path,
    *,
    metres_per_unit: float = 1.0,
    up: Literal["x", "y", "z"] | None = None,
    within: str | Path | None = None,
) -> Mesh:
    """Read all triangles of a file as one mesh with one texture.

    Several materials, and colours of vertices or faces, are baked into one texture. Normals, opacity and maps other
    than the colour are ignored. Coincident vertices are merged if the format duplicates them (GLB, OBJ, STL).

    Args:
        path: One of `LOADS`; files that it names are searched next to it.
        metres_per_unit: Length of a unit of the file [m]; for USD, of a metre, because a stage states its unit.
        up: Up axis of the file; None: y for GLB, as stated in a USD stage, z for the others.
        within: Folder with all files that it names; None: its own folder.

    Raises:
        ArtifactError: The file, or one that it names, is missing, damaged or outside of `within`, or it has no
            triangles or more than `bounds.MOST_TRIANGLES`.
    """
    path = Path(path)
    folder = path.parent if within is None else Path(within)
    suffix = suffix_among(Mesh.name(), path, LOADS)
    form = "USD" if suffix in _USD else suffix[1:].upper()
    if not path.is_file():
        raise unreadable(path, form, "there is no such file")
    axis: str
    try:
        if suffix in _USD:
            parts, unit, axis = mesh_usd.parts(path, folder)
            metres_per_unit *= unit
        else:
            parts, axis = _parts(path, suffix, folder), "y" if suffix == ".glb" else "z"
        whole = joined(list(mesh_bounds.few(parts, path)))
    except ValueError as error:
        raise unreadable(path, form, error) from None
    if not len(whole.faces):
        raise unreadable(path, form, "it holds no triangles")
    places = metres_per_unit * whole.vertices @ _UP[up or axis].T
    vertices, faces = places.astype(np.float32), whole.faces
    if suffix in _SPLIT:
        vertices, index = _merged(vertices)
        faces = index[faces]
    return Mesh(
        vertices=vertices,
        faces=faces.astype(np.int32),
        uv=None if whole.uv is None else whole.uv.astype(np.float32),
        texture=None if whole.picture is None else Image(pixels=np.ascontiguousarray(whole.picture)),
        colour=whole.colour,
    )


def save(mesh: Mesh, path: Path) -> list[Path]:
    """Write OBJ, or binary GLB (embedded texture), PLY (vertex colours), STL (geometry only) or USD; metres.

    GLB is rotated to y up by its root node, as the format requires; the others have z up.
    """
    suffix = path.suffix.lower()
    if suffix in _USD:
        return mesh_usd.write(mesh, path)
    if suffix == ".obj":
        return obj.write(mesh, path)
    import trimesh

    if suffix == ".glb":
        path.write_bytes(_glb(mesh))
    else:
        colours = None if suffix == ".stl" else np.round(255 * _vertex_colours(mesh)).astype(np.uint8)
        made = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colours, process=False)
        path.write_bytes(made.export(file_type=suffix[1:]))
    return [path]


def _glb(mesh: Mesh) -> bytes:
    import trimesh
    from PIL import Image as Pillow

    looks: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
    if mesh.texture is None or mesh.uv is None:
        vertices, faces = mesh.vertices, mesh.faces
        visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(**looks))
    else:
        rows = np.concatenate([mesh.vertices[mesh.faces].reshape(-1, 3), mesh.uv.reshape(-1, 2)], axis=1)
        rows, index = _merged(rows)
        vertices, faces = rows[:, :3], index.reshape(-1, 3)
        material = trimesh.visual.material.PBRMaterial(**looks, baseColorTexture=Pillow.fromarray(mesh.texture.pixels))
        visual = trimesh.visual.TextureVisuals(uv=rows[:, 3:], material=material)
    scene = trimesh.Scene()
    upright = np.eye(4)
    upright[:3, :3] = _UP["y"].T
    scene.add_geometry(
        trimesh.Trimesh(vertices, faces, visual=visual, process=False), geom_name="mesh", transform=upright
    )

    def finish(tree: dict[str, Any]) -> None:
        # Colours of glTF are linear; trimesh would round this one to a byte.
        if mesh.texture is None:
            colour = [*to_linear(np.array(mesh.colour)).tolist(), 1.0]
            tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = colour

    data: bytes = trimesh.exchange.gltf.export_glb(scene, include_normals=False, tree_postprocessor=finish)
    return data


def _vertex_colours(mesh: Mesh) -> np.ndarray:
    """SRGB (V, 3), 0..1: the mean over the corners at each vertex."""
    if mesh.texture is None:
        return np.tile(np.array(mesh.colour), (len(mesh.vertices), 1))
    face = np.repeat(np.arange(len(mesh.faces)), 3)
    shades = mesh.paint(face, np.tile(np.eye(3), (len(mesh.faces), 1)))
    owner = mesh.faces.reshape(-1)
    count = np.maximum(np.bincount(owner, minlength=len(mesh.vertices)), 1)
    sums = [np.bincount(owner, shades[:, channel], len(mesh.vertices)) for channel in range(3)]
    return np.asarray(np.stack(sums, axis=1) / count[:, None])


def _merged(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows in order of first occurrence, and the index of each original row among them."""
    _, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rows[first[order]], rank[index.reshape(-1)]


def _parts(path: Path, suffix: str, folder: Path) -> Iterator[Part]:
    """All meshes of a file that trimesh reads, placed in the scene."""
    import trimesh

    if suffix == ".obj":
        _check_libraries(path)
    beside = _Beside(path, folder, gltf.check(path) if suffix == ".glb" else ())
    try:
        with path.open("rb") as file:
            scene = trimesh.load_scene(file, file_type=suffix[1:], resolver=beside, process=False)
    except Exception as error:  # its parsers raise any exception on damaged files
        raise beside.fault or ValueError(str(error) or type(error).__name__) from None
    if beside.fault is not None:
        raise beside.fault
    for node in sorted(scene.graph.nodes_geometry):
        placed, name = scene.graph[node]
        made = scene.geometry[name]
        if isinstance(made, trimesh.Trimesh) and len(made.faces):
            vertices = made.vertices @ placed[:3, :3].T + placed[:3, 3]
            mirrors = np.linalg.det(placed[:3, :3]) < 0
            yield _part(made, vertices, slice(None, None, -1 if mirrors else 1), linear=suffix == ".glb")


def _plane(uv: np.ndarray) -> np.ndarray:
    """Coordinates (V, 2) in a picture, from lines `vt u [v [w]]` of an OBJ, where v is 0 by default."""
    found = np.zeros((len(uv), 2))
    found[:, : uv.shape[1]] = uv[:, :2]
    return found


def _part(made: Any, vertices: np.ndarray, order: slice, *, linear: bool) -> Part:
    """One mesh of trimesh; `order` of a face's corners."""
    faces = np.asarray(made.faces, np.int64)[:, order]
    if not (faces >= 0).all() or faces.max() >= len(vertices):
        raise ValueError(
            f"a triangle has corner {faces.min() if (faces < 0).any() else faces.max()}, and it has "
            f"{len(vertices)} vertices"
        )
    visual = made.visual
    if visual.kind == "texture":
        picture, colour = _material(visual.material)
        uv = None if visual.uv is None else _plane(np.asarray(visual.uv, np.float64))[faces]
        return Part(vertices, faces, colour, uv, picture)
    if visual.kind not in ("vertex", "face"):
        return Part(vertices, faces)
    shades = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3] / 255.0
    corners = shades[faces] if visual.kind == "vertex" else np.repeat(shades[:, None], 3, axis=1)
    return Part(vertices, faces, corners=to_srgb(corners) if linear else corners)


def _material(material: Any) -> tuple[np.ndarray | None, tuple[float, float, float]]:
    """Picture and sRGB colour of a material of trimesh; glTF multiplies the two in linear light."""
    if type(material).__name__ == "PBRMaterial":
        image = material.baseColorTexture or material.emissiveTexture
        factor = np.ones(3) if material.baseColorFactor is None else np.asarray(material.baseColorFactor)[:3] / 255.0
    else:
        image, factor = material.image, to_linear(np.asarray(material.diffuse)[:3] / 255.0)
    red, green, blue = to_srgb(factor).tolist()
    if image is None:
        return None, (red, green, blue)
    pixels = rgb(image)
    if type(material).__name__ == "PBRMaterial" and material.baseColorTexture is not None and (factor != 1).any():
        pixels = np.round(255 * to_srgb(to_linear(pixels / 255.0) * factor)).astype(np.uint8)
    return pixels, (red, green, blue)


class _Beside:
    """Files that a mesh names, for trimesh, which silently ignores missing ones.

    Args:
        path: The mesh.
        folder: Folder with all files.
        buffers: Names that are not pictures.
    """

    def __init__(self, path: Path, folder: Path, buffers: Collection[str]) -> None:
        self._names_by, self._folder, self._buffers = path, folder, buffers
        self.fault: ValueError | None = None
        """The first file that could not be supplied."""

    def get(self, name: str) -> bytes:
        """Content of a file; pictures are relative to the material library that names them."""
        try:
            place = named_files.found(_MAP_OPTIONS.sub("", name.strip()), self._names_by, self._folder)
            data = place.read_bytes()
            if place.suffix.lower() == ".mtl":
                self._names_by = place
            elif name not in self._buffers:
                opened(data, name)
        except ValueError as error:
            self.fault = self.fault or error
            raise
        return data

    __getitem__ = get


def _check_libraries(path: Path) -> None:
    """Raise for an OBJ with several material libraries, of which its parser would read only the first."""
    names = set(re.findall(r"^mtllib[ \t]+(.+?)\s*$", path.read_text("utf-8", errors="replace"), re.MULTILINE))
    if len(names) > 1:
        raise ValueError(f"it names {len(names)} material libraries, and one is read: {listing(names)}")
