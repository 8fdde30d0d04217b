"""The visible surfaces of a compiled MuJoCo model by body, for viewers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.sim.model import tessellate

FIRST_HIDDEN = 3
"""First group of collision and helper geoms, which MuJoCo's own viewer hides, too."""
PLANE_M = 2.0
"""Half edge of a plane without an extent [m]."""

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, sRGB 0..1."""


@dataclass(frozen=True)
class Skin:
    """Surfaces of one body with the same appearance."""

    vertices: np.ndarray
    """(V, 3) float32 in the body's frame [m]."""
    faces: np.ndarray
    """(F, 3)."""
    colour: Colour
    """Colour of surfaces without a texture."""
    texture: np.ndarray | None = None
    """(H, W, 3) uint8 sRGB."""
    uv: np.ndarray | None = None
    """(F * 3, 2) texture coordinates of each face's corners, v up."""
    glows: bool = False
    """Whether the texture includes the light of a photograph and needs no shading."""


def visible(model: Any, body: int) -> list[Skin]:
    """The visible surfaces of a body; geoms of one colour are one surface."""
    painted: dict[Colour, list[tuple[np.ndarray, np.ndarray]]] = {}
    found: list[Skin] = []
    for geom in _geoms(model, body):
        if model.geom_group[geom] >= FIRST_HIDDEN or colour(model, geom)[3] == 0:
            continue
        vertices, faces = _surface(model, geom)
        picture = _textured(model, geom)
        if picture is None:
            painted.setdefault(colour(model, geom), []).append((vertices, faces))
        else:
            uv, texture, glows = picture
            found.append(Skin(vertices, faces, colour(model, geom), texture, uv, glows))
    return [*found, *(Skin(*_joined(parts), colour) for colour, parts in painted.items())]


def colliding(model: Any, body: int) -> list[Skin]:
    """The collision surfaces of a body: one surface, or none."""
    parts = [_surface(model, geom) for geom in _geoms(model, body) if model.geom_contype[geom]]
    return [Skin(*_joined(parts), (0.3, 0.6, 0.9, 0.5))] if parts else []


def _geoms(model: Any, body: int) -> Iterator[int]:
    first = int(model.body_geomadr[body])
    yield from range(first, first + int(model.body_geomnum[body]))


def _surface(model: Any, geom: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float32 in the body's frame [m] and faces (F, 3)."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
        x, y = (float(half) or PLANE_M for half in model.geom_size[geom, :2])
        corners, faces = np.array([[-x, -y, 0.0], [x, -y, 0], [x, y, 0], [-x, y, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    else:
        corners, faces = tessellate.surface(model, geom)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return (corners @ turn.reshape(3, 3).T + model.geom_pos[geom]).astype(np.float32), faces


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    shifts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + shift for (_, faces), shift in zip(parts, shifts[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def colour(model: Any, geom: int) -> Colour:
    """Colour of a geom: its material's, or its own."""
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return tuple(round(float(part), 4) for part in rgba)  # type: ignore[return-value]


def _textured(model: Any, geom: int) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Texture coordinates, picture and the flag `glows` of a mesh with a texture."""
    material, mesh = int(model.geom_matid[geom]), int(model.geom_dataid[geom])
    if material < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH or model.mesh_texcoordadr[mesh] < 0:
        return None
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0:
        return None
    height, width, depth = (int(each[texture]) for each in (model.tex_height, model.tex_width, model.tex_nchannel))
    first = int(model.tex_adr[texture])
    pixels = model.tex_data[first : first + height * width * depth].reshape(height, width, depth)
    at, face, faces = model.mesh_texcoordadr[mesh], model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    corners = model.mesh_facetexcoord[face : face + faces].reshape(-1)
    uv = model.mesh_texcoord[at + corners].astype(np.float32)
    # MuJoCo counts v from the top.
    uv[:, 1] = 1.0 - uv[:, 1]
    return uv, np.ascontiguousarray(pixels[..., :3]), bool(model.mat_emission[material] > 0)
