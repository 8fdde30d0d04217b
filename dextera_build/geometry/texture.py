"""Texture atlases: division of a mesh into flat charts by six directions, packing, and texel positions.

Within a chart all normals have a positive component along the same axis, so no chart overlaps itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import raycast

GUTTER_PX = 3
"""Width of the margin around every chart that repeats its border, to keep filters from mixing charts [px]."""
SIDES = np.array(
    [
        [[0, 1, 0], [0, 0, 1]],
        [[0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0]],
        [[-1, 0, 0], [0, 1, 0]],
    ],
    np.float64,
)
"""Right and up axes of a chart seen from +x, -x, +y, -y, +z, -z."""


@dataclass(frozen=True)
class Atlas:
    """The location of every face in a picture."""

    uv: np.ndarray  # (F, 3, 2) float64, origin at the lower left, v up
    width: int  # [px]
    height: int  # [px]


@dataclass(frozen=True)
class Texels:
    """The texels that show a piece of the surface."""

    row: np.ndarray  # (N,) from the top
    column: np.ndarray  # (N,)
    points: np.ndarray  # (N, 3) position on the surface, the mesh's frame [m]
    normals: np.ndarray  # (N, 3) unit


def unwrap(vertices: np.ndarray, faces: np.ndarray, texel_m: float, most_px: int) -> Atlas:
    """Charts of a mesh, packed into a picture.

    Args:
        vertices: (V, 3) [m].
        faces: (F, 3).
        texel_m: Wanted size of a texel [m]; larger if the picture would be too large.
        most_px: Largest width and height [px].
    """
    side, chart = _charts(vertices, faces)
    corners = np.einsum("fkc,fdc->fkd", vertices[faces], SIDES[side])
    number = int(chart.max()) + 1
    low, high = np.full((number, 2), np.inf), np.full((number, 2), -np.inf)
    np.minimum.at(low, chart, corners.min(axis=1))
    np.maximum.at(high, chart, corners.max(axis=1))
    texel = texel_m
    while True:
        sizes = np.ceil((high - low) / texel).astype(int) + 2 * GUTTER_PX + 1
        found = packed(sizes, most_px)
        if found is not None:
            break
        texel *= 1.1
    place, width, height = found
    pixels = (corners - low[chart][:, None]) / texel + GUTTER_PX + 0.5 + place[chart][:, None]
    return Atlas(pixels / np.array([width, height]), width, height)


def texels(vertices: np.ndarray, faces: np.ndarray, atlas: Atlas) -> Texels:
    """All texels whose centre is on a face."""
    flat = atlas.uv.reshape(-1, 2) * [atlas.width, atlas.height]
    flat = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
    rows, columns = np.indices((atlas.height, atlas.width))
    rays = np.zeros((atlas.height, atlas.width, 6))
    rays[..., 0], rays[..., 1], rays[..., 2] = columns + 0.5, atlas.height - rows - 0.5, 1.0
    rays[..., 5] = -1.0
    hits = raycast.cast([raycast.Surface(flat, np.arange(len(flat)).reshape(-1, 3))], rays)
    row, column = np.nonzero(hits.index >= 0)
    face, weights = hits.face[row, column], hits.corner[row, column]
    points = np.einsum("nk,nkc->nc", weights, vertices[faces[face]])
    return Texels(row, column, points, face_normals(vertices, faces)[face])


def bled(pixels: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) with every texel outside `filled` (H, W) set to the colour of the nearest one inside."""
    from scipy import ndimage

    nearest = ndimage.distance_transform_edt(~filled, return_distances=False, return_indices=True)
    return np.asarray(pixels[nearest[0], nearest[1]])


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals (F, 3)."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20))


def _charts(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction 0..5 that each face looks towards, and the number of its connected chart."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    normal = face_normals(vertices, faces)
    axis = np.argmax(np.abs(normal) + 1e-6 * np.array([2.0, 1.0, 0.0]), axis=1)
    side = 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    owner = np.repeat(np.arange(len(faces)), 3)
    key = edges[:, 0] * len(vertices) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    first, second = owner[order][:-1][same], owner[order][1:][same]
    joined = side[first] == side[second]
    links = coo_array((np.ones(int(joined.sum())), (first[joined], second[joined])), shape=(len(faces), len(faces)))
    return side, connected_components(links, directed=False)[1]


def packed(sizes: np.ndarray, most: int) -> tuple[np.ndarray, int, int] | None:
    """Lower left corners (C, 2) of rectangles (C, 2) packed on shelves, and the size used; None if too large."""
    if sizes.max() > most:
        return None
    width = int(np.clip(np.sqrt(sizes.prod(axis=1).sum()) * 1.1, sizes[:, 0].max(), most))
    for _ in range(2):
        place, x, y, shelf = np.zeros((len(sizes), 2)), 0, 0, 0
        for i in np.lexsort((-sizes[:, 0], -sizes[:, 1])):
            if x + sizes[i, 0] > width:
                x, y, shelf = 0, y + shelf, 0
            place[i] = x, y
            x, shelf = x + int(sizes[i, 0]), max(shelf, int(sizes[i, 1]))
        if y + shelf <= most:
            return place, width, y + shelf
        width = most
    return None
