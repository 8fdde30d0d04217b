"""The texture of a body: from the photograph, then from further ones, by symmetry, and from the nearest colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, raycast, regions, texture, transforms
from dextera_build.geometry.solids import Solid

SLANTED, PLAIN = 0.15, 0.5
"""Cosines between normal and line of sight: texels below the first are not read, above the second trusted."""
EDGE_PX = (1.5, 4.0)
"""Distances from the mask's border [px]: pixels below the first are not read, above the second trusted."""
GUESS_FROM, GUESS_SOURCES, GUESS_BLOCK_PX = 16, 3000, 5
"""A guess averages the nearest GUESS_FROM of GUESS_SOURCES seen texels, once per block of GUESS_BLOCK_PX [px]."""
FEATHER_PX = 6.0
"""Width of the transition from read to guessed colours [px]."""
LEAST_BOTH, MOST_GAIN = 50, 2.0
"""Minimum number of texels that two photographs show, to compare their exposures, and the largest ratio of these."""
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
"""Half a turn about the body's vertical axis: a symmetry of boxes, cylinders and oval bodies."""
MIRROR = np.diag([1.0, -1.0, 1.0])
"""The mirror in the body's x-z plane: the symmetry of a mirrored body."""


@dataclass(frozen=True)
class Painted:
    """A texture for a mesh."""

    uv: np.ndarray  # (F, 3, 2) float32
    pixels: np.ndarray  # (h, w, 3) uint8
    seen: tuple[float, ...]  # fraction of the surface that each photograph shows, and none before it


def paint(
    body: Solid,
    pose: np.ndarray,
    seen: Seen,
    most_px: int,
    symmetry: np.ndarray | None = None,
    *,
    revolved: bool = False,
) -> Painted:
    """Texture of a body in its own frame.

    Args:
        body: Closed surface, own frame.
        pose: T_world_object (4, 4).
        seen: The view whose photograph is used, and further ones where it shows nothing.
        most_px: Largest width and height of the texture [px].
        symmetry: (3, 3) rotation or mirror of the body's frame that maps the body to itself, or None.
        revolved: Whether the body is rotationally symmetric about z; `symmetry` is then ignored.
    """
    distance = float(np.linalg.norm(pose[:3, 3] - seen.world_from_camera[:3, 3]))
    atlas = texture.unwrap(body.vertices, body.faces, 0.75 * distance / seen.camera.fx, most_px)
    texels = texture.texels(body.vertices, body.faces, atlas)
    photograph = _Photograph(body, pose, seen)
    read, trust = photograph.read(texels.points, texels.normals)
    colours = _guessed(texels, read, trust, seen, revolved=revolved)
    if revolved:
        symmetry = _facing_mirror(pose, seen)
    if symmetry is not None:
        twin, likely = photograph.read(texels.points @ symmetry.T, texels.normals @ symmetry.T)
        colours = _mixed(texels, atlas, colours, twin, likely)
    others = [_Photograph(body, pose, other) for other in seen.others]
    for other in reversed(others):
        twin, likely = other.read(texels.points, texels.normals)
        gain = _exposure(read, twin, np.minimum(trust, likely) > 0.6)
        colours = _mixed(texels, atlas, colours, (twin * gain).clip(0.0, 255.0), likely)
    colours = _mixed(texels, atlas, colours, read, trust)
    pixels, filled = _drawn(texels, atlas, colours), _drawn(texels, atlas, np.ones((len(colours), 1)))[..., 0] > 0
    pixels = np.round(texture.bled(pixels, filled)).clip(0, 255).astype(np.uint8)
    return Painted(atlas.uv.astype(np.float32), pixels, _fractions(body, [photograph, *others]))


def _facing_mirror(pose: np.ndarray, seen: Seen) -> np.ndarray:
    """The mirror (3, 3) at the body's vertical axis that swaps the front, as the camera sees it, and the back."""
    towards = pose[:3, :3].T @ (seen.world_from_camera[:3, 3] - pose[:3, 3])
    towards[2] = 0.0
    towards /= max(float(np.linalg.norm(towards)), 1e-9)
    return np.asarray(np.eye(3) - 2.0 * np.outer(towards, towards))


def _drawn(texels: texture.Texels, atlas: texture.Atlas, values: np.ndarray) -> np.ndarray:
    """Values (N, C) of the texels as a picture (H, W, C), 0 elsewhere."""
    picture = np.zeros((atlas.height, atlas.width, values.shape[1]))
    picture[texels.row, texels.column] = values
    return picture


def _mixed(
    texels: texture.Texels, atlas: texture.Atlas, under: np.ndarray, over: np.ndarray, trust: np.ndarray
) -> np.ndarray:
    """Blend: `over` (N, 3) where trusted, fading into `under` at the border of that region."""
    from scipy import ndimage

    untrusted = _drawn(texels, atlas, (trust <= 0.0)[:, None].astype(np.float64))[..., 0] > 0
    distance = ndimage.distance_transform_edt(~untrusted)[texels.row, texels.column]
    weight = np.minimum(trust, distance / FEATHER_PX).clip(0.0, 1.0)[:, None]
    return np.asarray(under + weight * (over - under))


class _Photograph:
    """Reads colours of visible surface points from the photograph."""

    def __init__(self, body: Solid, pose: np.ndarray, seen: Seen) -> None:
        from scipy import ndimage

        self.body, self.pose, self.seen = body, pose, seen
        self.camera_from_object = transforms.invert(seen.world_from_camera) @ pose
        self.eye = transforms.invert(self.camera_from_object)[:3, 3]
        self.k = seen.camera.matrix()
        self.inset = ndimage.distance_transform_edt(regions.without_pinholes(seen.mask) & ~seen.occluder)
        self.pixels = seen.rgb.astype(np.float64)

    def read(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colours (N, 3) and their trust (N,), 0 to 1."""
        place = cameras.project(transforms.apply(self.camera_from_object, points), self.k)
        height, width = self.inset.shape
        within = (place > 0).all(axis=1) & (place[:, 0] < width - 1) & (place[:, 1] < height - 1)
        place = np.where(within[:, None], place, 0.0)
        corner = np.floor(place).astype(int)
        part = place - corner
        colour, inset = np.zeros((len(points), 3)), np.zeros(len(points))
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            row, column = np.minimum(corner[:, 1] + dy, height - 1), np.minimum(corner[:, 0] + dx, width - 1)
            colour += weight[:, None] * self.pixels[row, column]
            inset += weight * self.inset[row, column]
        slant = (self.facing(points, normals) - SLANTED) / (PLAIN - SLANTED)
        border = (inset - EDGE_PX[0]) / (EDGE_PX[1] - EDGE_PX[0])
        trust = np.minimum(slant, border).clip(0.0, 1.0) * within
        return colour, trust * self.open(points, normals)

    def facing(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Cosine (N,) between normals and the directions to the camera."""
        sight = self.eye - points
        return np.asarray((sight * normals).sum(axis=1) / np.linalg.norm(sight, axis=1))

    def open(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Whether points (N,) face the camera and are not self-occluded."""
        sight = points - self.eye
        length = np.linalg.norm(sight, axis=1)
        surface = raycast.Surface(self.body.vertices, self.body.faces)
        rays = np.concatenate([np.broadcast_to(self.eye, sight.shape), sight], axis=1)
        first = raycast.cast([surface], rays).depth
        # A mirrored point off the body is hit too late or too early.
        facing = self.facing(points, normals) > 0.0
        return np.asarray(facing & (np.abs(first - 1.0) * length < 0.0015 + 0.002 * length))

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Whether the photograph shows surface points (N,)."""
        place = cameras.project(transforms.apply(self.camera_from_object, points), self.k)
        nearest = np.clip(np.round(place).astype(int), 0, np.array(self.seen.mask.shape)[::-1] - 1)
        return np.asarray(self.open(points, normals) & self.seen.mask[nearest[:, 1], nearest[:, 0]])


def _fractions(body: Solid, photographs: list[_Photograph]) -> tuple[float, ...]:
    """Fraction of the surface area that each photograph shows, and none before it."""
    a, b, c = np.moveaxis(body.vertices[body.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    normals = texture.face_normals(body.vertices, body.faces)
    totals = [0.0] * len(photographs)
    for weights in ((4, 1, 1), (1, 4, 1), (1, 1, 4), (2, 2, 2)):
        points = (weights[0] * a + weights[1] * b + weights[2] * c) / 6.0
        left = np.ones(len(points), bool)
        for number, photograph in enumerate(photographs):
            lit = photograph.lit(points, normals) & left
            totals[number] += float((area * lit).sum()) / 4.0
            left &= ~lit
    return tuple(total / float(area.sum()) for total in totals)


def _exposure(first: np.ndarray, other: np.ndarray, both: np.ndarray) -> np.ndarray:
    """Gains (3,) of another photograph's colours (N, 3) to agree with the first one's where `both` (N,) are trusted."""
    if both.sum() < LEAST_BOTH:
        return np.ones(3)
    ratio = (np.median(first[both], axis=0) + 1.0) / (np.median(other[both], axis=0) + 1.0)
    return np.asarray(ratio.clip(1.0 / MOST_GAIN, MOST_GAIN))


def _guessed(texels: texture.Texels, read: np.ndarray, trust: np.ndarray, seen: Seen, *, revolved: bool) -> np.ndarray:
    """Colours (N, 3): mean of the nearest trusted ones with a similar normal; around the axis if `revolved`."""
    from scipy.spatial import cKDTree

    source = np.flatnonzero(trust > min(0.6, 0.9 * float(trust.max(initial=0.0))))
    if not len(source):
        mask = seen.mask if seen.mask.any() else np.ones_like(seen.mask)
        return np.broadcast_to(np.median(seen.rgb[mask], axis=0), read.shape).astype(np.float64)
    source = source[:: max(1, len(source) // GUESS_SOURCES)]
    size = float(np.ptp(texels.points, axis=0).max())
    keys = (
        _ring_keys(texels, size) if revolved else np.concatenate([texels.points, 0.3 * size * texels.normals], axis=1)
    )
    missing = np.flatnonzero(trust < 1.0)
    # Guesses vary slowly: one per small block of texels facing the same side is enough.
    side = np.abs(texels.normals[missing]).argmax(axis=1)
    side = 2 * side + (np.take_along_axis(texels.normals[missing], side[:, None], axis=1)[:, 0] < 0)
    blocks = np.stack([texels.row[missing] // GUESS_BLOCK_PX, texels.column[missing] // GUESS_BLOCK_PX, side], axis=1)
    _, first, block = np.unique(blocks, axis=0, return_index=True, return_inverse=True)
    number = min(GUESS_FROM, len(source))
    nearest = cKDTree(keys[source]).query(keys[missing[first]], k=number)[1].reshape(len(first), number)
    colours = read.copy()
    colours[missing] = read[source][nearest].mean(axis=1)[block.ravel()]
    return colours


def _ring_keys(texels: texture.Texels, size: float) -> np.ndarray:
    """Keys (N, 6) that place texels at one height of a revolved body close together, at any angle."""
    radius = np.linalg.norm(texels.points[:, :2], axis=1)
    out = (texels.points[:, :2] * texels.normals[:, :2]).sum(axis=1) / np.maximum(radius, 1e-9)
    facing = 0.3 * size * np.stack([out, texels.normals[:, 2]], axis=1)
    return np.concatenate([0.1 * texels.points[:, :2], np.stack([radius, texels.points[:, 2]], axis=1), facing], axis=1)
