"""Baking of several materials of a mesh into one texture: pictures side by side, corner colours in patches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry.texture import packed

LARGEST_PX = 16_384
"""Largest width and height of a texture [px]."""
_GUTTER_PX = 2
"""Width of the repeated border of each picture, which keeps filters from mixing neighbours [px]."""
_BLOCK = 3
"""Texels along each side of the patch of a face whose corners have colours."""
_REPEATS = 64
"""Maximum number of copies of a picture that repeats across one face, along each axis."""


@dataclass(frozen=True)
class Part:
    """A piece of a surface with one material: `picture`, else `corners`, else `colour`."""

    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3)
    colour: tuple[float, float, float] = (0.7, 0.7, 0.7)  # sRGB, 0..1
    uv: np.ndarray | None = None  # (F, 3, 2) of the picture, lower left origin, repeated outside 0..1
    picture: np.ndarray | None = None  # (H, W, 3) uint8
    corners: np.ndarray | None = None  # (F, 3, 3) sRGB 0..1 of each face's corners


@dataclass(frozen=True)
class Surface:
    """All parts as one mesh."""

    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3) int64
    colour: tuple[float, float, float]
    uv: np.ndarray | None  # (F, 3, 2) within 0..1
    picture: np.ndarray | None  # (H, W, 3) uint8


def joined(parts: Sequence[Part]) -> Surface:
    """All parts as one surface with one texture, or one colour if all have the same.

    Raises:
        ValueError: The texture would be larger than `LARGEST_PX`.
    """
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.concatenate([np.zeros((0, 3)), *(part.vertices for part in parts)])
    faces = np.concatenate(
        [np.zeros((0, 3), np.int64), *(part.faces + start for part, start in zip(parts, starts, strict=False))]
    )
    parts = [_plain(part) for part in parts if len(part.faces)]
    colours = {part.colour for part in parts if part.picture is None and part.corners is None}
    if all(part.picture is None and part.corners is None for part in parts) and len(colours) < 2:
        return Surface(vertices, faces, next(iter(colours), Part.colour), None, None)
    tiles = [_tile(part) for part in parts]
    if len(tiles) == 1:
        return Surface(vertices, faces, Part.colour, *tiles[0])
    return Surface(vertices, faces, Part.colour, *_atlas(tiles))


def _plain(part: Part) -> Part:
    """The part with one colour, if all its corners have the same."""
    if part.picture is not None and part.uv is not None:
        return part
    corners = part.corners
    if corners is None or (corners == corners[:1, :1]).all():
        red, green, blue = part.colour if corners is None else corners[0, 0].tolist()
        return Part(part.vertices, part.faces, (red, green, blue))
    return Part(part.vertices, part.faces, corners=corners)


def _tile(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """Texture coordinates within 0..1 and the picture of one part."""
    if part.picture is not None and part.uv is not None:
        return _repeated(part.uv, part.picture)
    if part.corners is not None:
        return _painted(part.corners)
    shade = np.round(255 * np.array(part.colour)).astype(np.uint8)
    return np.full((len(part.faces), 3, 2), 0.5), np.tile(shade, (4, 4, 1))


def _repeated(uv: np.ndarray, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates within 0..1 in a picture with as many copies as a face shows at once."""
    if uv.min() >= 0 and uv.max() <= 1:
        return uv, picture
    if not np.isfinite(uv).all():
        raise ValueError("its texture coordinates are not all finite")
    uv = uv - np.floor(uv.min(axis=1, keepdims=True) + 1e-6)
    copies = np.maximum(np.ceil(uv.max(axis=(0, 1)) - 1e-4), 1).astype(int)
    if (copies > _REPEATS).any() or (copies * picture.shape[1::-1] > LARGEST_PX).any():
        raise ValueError(
            f"its picture repeats {copies[0]} x {copies[1]} times across a face, too often for one texture"
        )
    return (uv / copies).clip(0, 1), np.tile(picture, (copies[1], copies[0], 1))


def _painted(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A patch per face; between the centres of its corner texels a bilinear filter gives the linear blend exactly."""
    side = int(np.ceil(np.sqrt(len(corners))))
    if side * _BLOCK > LARGEST_PX:
        raise ValueError(f"its {len(corners):,} faces have colours of their own, too many for one texture")
    row, column = np.divmod(np.arange(len(corners)), side)
    step = np.arange(_BLOCK) / (_BLOCK - 1)
    first, right, up = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    texels = first[:, None, None] + step[:, None] * right[:, None, None] + step[:, None, None] * up[:, None, None]
    blocks = np.zeros((side, side, _BLOCK, _BLOCK, 3), np.uint8)  # rows upwards
    blocks[row, column] = np.round(255 * texels.clip(0, 1))
    picture = blocks.transpose(0, 2, 1, 3, 4).reshape(side * _BLOCK, side * _BLOCK, 3)[::-1]
    places = np.array([[0.5, 0.5], [_BLOCK - 0.5, 0.5], [0.5, _BLOCK - 0.5]])
    uv = (np.stack([column, row], axis=1)[:, None] * _BLOCK + places) / (side * _BLOCK)
    return uv, np.ascontiguousarray(picture)


def _atlas(tiles: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    sizes = np.array([picture.shape[1::-1] for _, picture in tiles]) + 2 * _GUTTER_PX
    found = packed(sizes, LARGEST_PX)
    if found is None:
        raise ValueError(f"its {len(tiles)} pictures are together larger than {LARGEST_PX} x {LARGEST_PX} px")
    places, width, height = found
    whole = np.zeros((height, width, 3), np.uint8)
    moved = []
    for (uv, picture), (x, y), (wide, high) in zip(tiles, places.astype(int), sizes, strict=True):
        padded = np.pad(picture, ((_GUTTER_PX, _GUTTER_PX), (_GUTTER_PX, _GUTTER_PX), (0, 0)), mode="edge")
        whole[height - y - high : height - y, x : x + wide] = padded
        inner = uv * picture.shape[1::-1] + [x + _GUTTER_PX, y + _GUTTER_PX]
        moved.append(inner / [width, height])
    return np.concatenate(moved), whole
