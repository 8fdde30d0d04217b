"""Objects of a reference world as MuJoCo geoms: textured visual surfaces, convex collision pieces, true masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.scenes.world import Matter, Part
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.formats import obj
from dextera_build.geometry import convex, massprops, quaternions, solids
from dextera_build.geometry.shading import corner_normals
from dextera_build.sim.model import mjcf_contact

BOX = 0.995
"""Fraction of its bounding box above which a convex piece collides as a box, which rests more stably than a mesh."""
FRICTION = (mjcf_contact.TORSION_M, mjcf_contact.ROLLING_M)
"""Torsional and rolling friction [m], as in the twin; neither is measured."""


class Stock:
    """Adds geoms to a spec and collects their files.

    Args:
        spec: The `mujoco.MjSpec`; its meshes and textures are under `assets/`.
        rate: Natural frequency of contacts [rad/s].
    """

    def __init__(self, spec: Any, rate: float) -> None:
        self.spec = spec
        self.rate = rate
        self.files: dict[str, bytes] = {}

    def look(self, body: Any, name: str, part: Part, pose: np.ndarray) -> None:
        """Add a part's visual surface at `pose` (T_body_part), without collision."""
        self._file(f"{name}.obj", shaded_obj(part.mesh).encode())
        mesh = self.spec.add_mesh(name=name, file=f"{name}.obj")
        # Thin or open parts must not fail compilation; masses are explicit.
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        material = self.spec.add_material(
            name=name, specular=part.gloss, shininess=0.5, rgba=[*part.mesh.colour, 1.0], reflectance=0.0
        )
        if part.mesh.texture is not None:
            self._file(f"{name}.png", png(part.mesh.texture.pixels, level=1))
            self.spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, file=f"{name}.png")
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
            material.rgba[:] = 1.0
        geom = body.add_geom(name=f"{name}_visual", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name)
        _place(geom, pose)
        geom.group, geom.contype, geom.conaffinity, geom.mass = 2, 0, 0, 0.0

    def touch(self, body: Any, name: str, piece: Hull, pose: np.ndarray, matter: Matter | None) -> None:
        """Add a convex piece at `pose` (T_body_piece); without `matter` it is static."""
        centre, half = as_box(piece)
        if half is not None:
            geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=half)
            shift = np.eye(4)
            shift[:3, 3] = centre
            pose = pose @ shift
        else:
            vertices, faces = convex.surface(piece.vertices)
            self._file(f"{name}.obj", obj.text(Mesh(vertices=vertices, faces=faces)).encode())
            self.spec.add_mesh(name=name, file=f"{name}.obj")
            geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name)
        _place(geom, pose)
        geom.group, geom.condim, geom.rgba = 3, 4, [0.9, 0.6, 0.3, 0.4]
        geom.solref = self._solref(0.0 if matter is None else matter.restitution)
        if matter is not None:
            # As in the twin, an object's own friction and restitution apply to contacts with static geometry.
            geom.priority = 1
            geom.friction = [matter.friction, *FRICTION]

    def _solref(self, restitution: float) -> tuple[float, float]:
        ratio = mjcf_contact.solref(restitution)[1]
        return 1.0 / (self.rate * ratio), ratio

    def _file(self, name: str, data: bytes) -> None:
        self.files[f"assets/{name}"] = data


def weigh(body: Any, parts: Sequence[Part], mass_kg: float, pose: np.ndarray) -> None:
    """Write a body's inertial: `mass_kg` distributed uniformly over the union of the parts, at `pose` (T_body_part)."""
    filled = solids.union([solids.Solid(part.mesh.vertices.astype(np.float64), part.mesh.faces) for part in parts])
    whole = massprops.of_mesh(filled.vertices, filled.faces)
    turn = pose[:3, :3]
    put(body, mass_kg, turn @ whole.centre + pose[:3, 3], turn @ (whole.inertia * (mass_kg / whole.volume)) @ turn.T)


def put(body: Any, mass_kg: float, centre: np.ndarray, inertia: np.ndarray) -> None:
    """Write mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg m^2] into a spec's body."""
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    axes[:, 0] *= np.linalg.det(axes)
    body.explicitinertial = True
    body.mass = mass_kg
    body.ipos, body.iquat, body.inertia = centre, quaternions.from_matrix(axes), moments


def as_box(piece: Hull) -> tuple[np.ndarray, np.ndarray | None]:
    """Centre (3,) of a piece's bounding box, and its half edges (3,) if the piece fills the box, otherwise None [m]."""
    low, high = piece.vertices.min(axis=0).astype(np.float64), piece.vertices.max(axis=0).astype(np.float64)
    vertices, faces = convex.surface(piece.vertices)
    filled = solids.Solid(vertices.astype(np.float64), faces).volume / float(np.prod(high - low))
    return (low + high) / 2, (high - low) / 2 if filled > BOX else None


def shaded_obj(mesh: Mesh) -> str:
    """Wavefront OBJ text with shading normals that keep sharp edges."""
    normals = corner_normals(mesh.vertices, mesh.faces)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in (normals + 0.0).tolist()]
    textured = mesh.uv is not None
    if mesh.uv is not None:
        lines += [f"vt {u:.6f} {v:.6f}" for u, v in mesh.uv.reshape(-1, 2).tolist()]
    for row, face in enumerate((mesh.faces + 1).tolist()):
        corners = [3 * row + 1, 3 * row + 2, 3 * row + 3]
        words = [f"{v}/{c if textured else ''}/{c}" for v, c in zip(face, corners, strict=True)]
        lines.append("f " + " ".join(words))
    return "\n".join(lines) + "\n"


def _place(geom: Any, pose: np.ndarray) -> None:
    geom.pos, geom.quat = pose[:3, 3], quaternions.from_matrix(pose[:3, :3])
