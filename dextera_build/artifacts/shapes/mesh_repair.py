"""Repair of meshes from other programs, with a report of the changes."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from dextera_build.artifacts.base import Value
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.errors import MachineError, install_extra
from dextera_build.geometry import repair, solids
from dextera_build.geometry.repair import Triangles


class Repair(Value):
    """Changes and result of a repair."""

    method: Literal["manifold", "meshlab"]
    """`manifold`: own repairs, validated by manifold3d. `meshlab`: filters of PyMeshLab first."""
    changes: dict[str, int]
    """Kind of change -> count, if above 0."""
    open_edges_before: int
    """Edges not shared by exactly two faces in opposite directions, with coincident vertices merged."""
    open_edges: int
    """The same afterwards."""
    is_solid: bool
    """Whether manifold3d accepts the result as a solid, as required for booleans and exact volumes."""
    volume_m3: float | None
    """Volume of the solid [m^3]; None if it is not a solid."""

    def __str__(self) -> str:
        """`12 vertices welded, 1 holes filled, 2 faces added; closed, 1.2e-03 m^3`."""
        done = ", ".join(f"{number:,} {what}" for what, number in self.changes.items()) or "nothing changed"
        volume = "" if self.volume_m3 is None else f", {self.volume_m3:.3g} m^3"
        return f"{done}; {'closed' if self.open_edges == 0 else f'{self.open_edges:,} open edges'}{volume}"


def repaired(
    mesh: Mesh,
    *,
    method: Literal["manifold", "meshlab"] = "manifold",
    weld_m: float = 1e-6,
    longest_hole: int = 1000,
) -> tuple[Mesh, Repair]:
    """A mesh that is closed if possible, with the old texture; faces that fill holes have the colour at their border.

    Args:
        mesh: Any mesh.
        method: `meshlab` also splits edges at which more than two faces meet; it needs the extra `repair`.
        weld_m: Vertices at most this far apart are merged [m].
        longest_hole: Maximum number of edges of a hole that is filled.

    Raises:
        MachineError: PyMeshLab is requested and not installed.
    """
    counts: dict[str, int] = {}
    given, uv = mesh.faces, mesh.uv
    vertices = mesh.vertices.astype(np.float64)
    if method == "meshlab":
        vertices, given, uv, counts = _filtered(mesh, weld_m, longest_hole)
    # MeshLab splits vertices on purpose.
    made = repair.repaired(vertices, given, None if method == "meshlab" else weld_m, longest_hole)
    new = Mesh(
        vertices=made.vertices.astype(np.float32),
        faces=made.faces.astype(np.int32),
        uv=None if uv is None else _coordinates(made, uv),
        texture=mesh.texture,
        colour=mesh.colour,
    )
    volume = _volume(new)
    changes = {what: number for what, number in (counts | made.counts).items() if number}
    report = Repair(
        method=method,
        changes=changes,
        open_edges_before=repair.open_edges(_at_one_place(mesh)),
        open_edges=repair.open_edges(made.faces),
        is_solid=volume is not None,
        volume_m3=volume,
    )
    return new, report


def _at_one_place(mesh: Mesh) -> np.ndarray:
    """Faces with coincident vertices merged."""
    return np.asarray(np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.faces])


def _coordinates(made: Triangles, uv: np.ndarray) -> np.ndarray:
    """Texture coordinates (F, 3, 2); corners of new faces take those of an old face at the same vertex."""
    flat = uv.reshape(-1, 2)
    old = made.source >= 0
    found = np.zeros((*made.faces.shape, 2), np.float32)
    found[old] = flat[made.source[old]]
    known = np.zeros((len(made.vertices), 2), np.float32)
    known[made.faces[old]] = found[old]
    found[~old] = known[made.faces[~old]]
    return found


def _volume(mesh: Mesh) -> float | None:
    solid = solids.manifold(mesh.vertices, mesh.faces)
    return None if solid.is_empty() else float(solid.volume())


def _filtered(
    mesh: Mesh, weld_m: float, longest_hole: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, int]]:
    """Vertices, faces, texture coordinates and changes after filters of MeshLab."""
    try:
        import pymeshlab
    except ImportError:
        raise MachineError(
            "repair with method `meshlab` needs PyMeshLab, which is not installed",
            code="DXB-E420",
            hint=f"{install_extra('repair')}; or use method `manifold`",
        ) from None
    coordinates: dict[str, Any] = {}
    if mesh.uv is not None:
        coordinates["w_tex_coords_matrix"] = mesh.uv.reshape(-1, 2).astype(np.float64)
    filters = pymeshlab.MeshSet(verbose=False)
    filters.add_mesh(
        pymeshlab.Mesh(vertex_matrix=mesh.vertices.astype(np.float64), face_matrix=mesh.faces, **coordinates)
    )
    counts: dict[str, int] = {}
    before = len(mesh.faces)
    filters.meshing_merge_close_vertices(threshold=pymeshlab.PureValue(weld_m))
    filters.meshing_remove_duplicate_faces()
    filters.meshing_remove_null_faces()
    filters.meshing_repair_non_manifold_edges()
    filters.meshing_repair_non_manifold_vertices()
    kept = filters.current_mesh().face_number()
    counts["faces dropped by MeshLab"] = before - kept
    filters.meshing_close_holes(maxholesize=longest_hole)
    counts["faces added by MeshLab"] = filters.current_mesh().face_number() - kept
    done = filters.current_mesh()
    uv = None if mesh.uv is None else done.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    return done.vertex_matrix(), done.face_matrix().astype(np.int64), uv, counts
