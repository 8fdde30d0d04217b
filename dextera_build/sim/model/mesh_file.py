"""Read a mesh file with MuJoCo, which supports OBJ, STL and its own former format MSH."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from dextera_build.errors import RuleError


@dataclass(frozen=True)
class Triangles:
    """A surface as stored in a file."""

    vertices: np.ndarray  # (V, 3) float64, in the file's frame
    faces: np.ndarray  # (F, 3) int32
    uv: np.ndarray | None  # (F, 3, 2) float32, origin at the lower left; None without texture coordinates


def read(name: str, data: bytes) -> Triangles:
    """Read the mesh file `name`, whose suffix gives the format.

    Raises:
        RuleError: MuJoCo cannot read it.
    """
    spec = mujoco.MjSpec()
    asset = spec.add_mesh(name="mesh", file=name)
    # Third-party surfaces are often open, and only shells can compute an inertia for them.
    asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    spec.assets = {name: data}
    try:
        model = spec.compile()
    except ValueError as error:
        raise RuleError(
            f"`{name}` cannot be read as a mesh",
            facts={"reason": str(error).splitlines()[0]},
            hint="give an OBJ, STL or MSH file",
        ) from None
    return _of(model)


def _of(model: mujoco.MjModel) -> Triangles:
    """The only mesh of a compiled model, transformed from its principal axes back to the file's frame."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.mesh_quat[0])
    vertices = model.mesh_vert.astype(np.float64) @ turn.reshape(3, 3).T + model.mesh_pos[0]
    if not model.mesh_texcoordnum[0]:
        return Triangles(vertices, model.mesh_face.copy(), None)
    # MuJoCo's v starts at the upper edge of the picture.
    uv = model.mesh_texcoord[model.mesh_facetexcoord] * [1, -1] + [0, 1]
    return Triangles(vertices, model.mesh_face.copy(), uv.astype(np.float32))
