"""Pieces of surface, each with its own picture, and their combination into one mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.shapes.mesh import Mesh

BORDER_PX = 4
"""Width of a border of copied pixels around a texture [px]."""


@dataclass(frozen=True)
class Piece:
    """Triangles in the world frame."""

    vertices: np.ndarray  # (V, 3) float64 [m]
    faces: np.ndarray  # (F, 3), counter-clockwise from the visible side
    pixel: np.ndarray  # (V, 2) column and row in `picture`, integer pixel centres
    picture: np.ndarray  # (h, w, 3) uint8


def quad(corners: np.ndarray, picture: np.ndarray) -> Piece:
    """A rectangle: (4, 3) corners of the picture's upper left, lower left, lower right and upper right."""
    height, width = picture.shape[:2]
    left, top, right, bottom = -0.5, -0.5, width - 0.5, height - 0.5
    pixel = np.array([[left, top], [left, bottom], [right, bottom], [right, top]])
    return Piece(np.asarray(corners, np.float64), np.array([[0, 1, 2], [0, 2, 3]]), pixel, picture)


def one_picture(pieces: Sequence[Piece], picture: np.ndarray) -> Mesh:
    """Pieces that all show the same picture, as one mesh with that texture."""
    start = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
    vertices = np.concatenate([np.zeros((0, 3)), *(piece.vertices for piece in pieces)])
    faces = np.concatenate(
        [np.zeros((0, 3), np.int64), *(p.faces + n for p, n in zip(pieces, start[:-1], strict=True))]
    )
    pixel = np.concatenate([np.zeros((0, 2)), *(piece.pixel for piece in pieces)])
    height, width = picture.shape[:2]
    pixel = pixel.clip(-0.5, [width - 0.5, height - 0.5]) + BORDER_PX + 0.5
    uv = np.stack([pixel[:, 0] / (width + 2 * BORDER_PX), 1.0 - pixel[:, 1] / (height + 2 * BORDER_PX)], axis=1)
    return Mesh(
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv[faces].astype(np.float32).reshape(-1, 3, 2),
        texture=Image(pixels=bordered(picture)),
    )


def bordered(picture: np.ndarray) -> np.ndarray:
    """A picture (h, w, 3) as a texture, with a border of copied pixels.

    Renderers repeat textures, and average them for views from afar: near the border, they mix the opposite one in.
    """
    return np.pad(picture, ((BORDER_PX, BORDER_PX), (BORDER_PX, BORDER_PX), (0, 0)), mode="edge")


def atlas(pieces: Sequence[Piece]) -> Mesh:
    """Pieces with different pictures, as one mesh whose texture has these pictures below one another."""
    pictures: dict[int, np.ndarray] = {id(piece.picture): piece.picture for piece in pieces}
    width = max(picture.shape[1] for picture in pictures.values()) + 2
    rows, top = {}, 0
    for key, picture in pictures.items():
        rows[key], top = top + 1, top + picture.shape[0] + 2
    whole = np.zeros((top, width, 3), np.uint8)
    for key, picture in pictures.items():
        # A rim of copied pixels prevents bleeding between neighbours in the atlas.
        wide = np.pad(picture, ((1, 1), (1, width - 1 - picture.shape[1]), (0, 0)), mode="edge")
        whole[rows[key] - 1 : rows[key] + picture.shape[0] + 1] = wide
    moved = []
    for piece in pieces:
        height, columns = piece.picture.shape[:2]
        inside = piece.pixel.clip(-0.5, [columns - 0.5, height - 0.5])
        moved.append(Piece(piece.vertices, piece.faces, inside + np.array([1, rows[id(piece.picture)]]), whole))
    return one_picture(moved, whole)
