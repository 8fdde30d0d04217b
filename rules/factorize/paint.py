"""The texture of a body: what the photograph shows, then what symmetry says, then the nearest seen colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.object import ObjectView
from dextera_build.geometry import cameras, raycast, texture, transforms
from dextera_build.geometry.solids import Solid

FACING = 0.22
"""Cosine between normal and line of sight below which a texel is too slanted to be read from the photograph."""
HALF_TURN = np.array([-1.0, -1.0, 1.0])
"""Half a turn about the body's vertical axis: a symmetry of boxes, cylinders, revolved and oval bodies."""


@dataclass(frozen=True)
class Painted:
    """A texture for a mesh."""

    uv: np.ndarray  # (F, 3, 2) float32
    pixels: np.ndarray  # (h, w, 3) uint8
    seen_fraction: float  # part of the surface that the camera saw


def paint(body: Solid, pose: np.ndarray, seen: ObjectView, most_px: int, *, turned: bool) -> Painted:
    """Texture of a body in its own frame.

    Args:
        body: Closed surface, own frame.
        pose: T_world_object (4, 4).
        seen: The view whose photograph is used.
        most_px: Largest width and height of the texture [px].
        turned: Whether half a turn about z is a symmetry of the body.
    """
    distance = float(np.linalg.norm(pose[:3, 3] - seen.world_from_camera[:3, 3]))
    atlas = texture.unwrap(body.vertices, body.faces, 0.75 * distance / seen.camera.fx, most_px)
    texels = texture.texels(body.vertices, body.faces, atlas)
    from_photo = _Photograph(body, pose, seen)
    colours, good = from_photo.read(texels.points, texels.normals)
    if turned:
        mirrored, reachable = from_photo.read(texels.points * HALF_TURN, texels.normals * HALF_TURN)
        colours = np.where(good[:, None], colours, mirrored)
        good = good | reachable
    colours = _filled(texels, colours, good, seen)
    pixels = np.zeros((atlas.height, atlas.width, 3))
    filled = np.zeros((atlas.height, atlas.width), bool)
    pixels[texels.row, texels.column], filled[texels.row, texels.column] = colours, True
    pixels = np.round(texture.bled(pixels, filled)).clip(0, 255).astype(np.uint8)
    return Painted(atlas.uv.astype(np.float32), pixels, from_photo.seen_fraction())


class _Photograph:
    """Reads colours of surface points from the photograph, where the camera sees them."""

    def __init__(self, body: Solid, pose: np.ndarray, seen: ObjectView) -> None:
        from scipy import ndimage

        self.body, self.pose, self.seen = body, pose, seen
        self.camera_from_object = transforms.invert(seen.world_from_camera) @ pose
        self.eye = transforms.invert(self.camera_from_object)[:3, 3]
        self.k = seen.camera.matrix()
        self.usable = ndimage.binary_erosion(seen.mask & ~seen.occluder, iterations=2)
        self.pixels = seen.rgb.pixels.astype(np.float64)

    def read(self, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colours (N, 3) and which of them are to be trusted (N,)."""
        place = cameras.project(transforms.apply(self.camera_from_object, points), self.k)
        height, width = self.usable.shape
        within = (place > 0).all(axis=1) & (place[:, 0] < width - 1) & (place[:, 1] < height - 1)
        place = np.where(within[:, None], place, 0.0)
        nearest = np.round(place).astype(int)
        good = within & self.usable[nearest[:, 1], nearest[:, 0]]
        good &= self.open(points, normals, FACING)
        corner = np.floor(place).astype(int)
        part = place - corner
        colour = np.zeros((len(points), 3))
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            row, column = np.minimum(corner[:, 1] + dy, height - 1), np.minimum(corner[:, 0] + dx, width - 1)
            colour += weight[:, None] * self.pixels[row, column]
        return colour, good

    def open(self, points: np.ndarray, normals: np.ndarray, facing: float) -> np.ndarray:
        """Points (N,) that face the camera and that the body itself does not hide."""
        sight = points - self.eye
        length = np.linalg.norm(sight, axis=1)
        towards = -(sight * normals).sum(axis=1) / length > facing
        surface = raycast.Surface(self.body.vertices, self.body.faces)
        rays = np.concatenate([np.broadcast_to(self.eye, sight.shape), sight], axis=1)
        first = raycast.cast([surface], rays).depth
        # A point reflected off the body into thin air is met too late or too early.
        return np.asarray(towards & (np.abs(first - 1.0) * length < 0.0015 + 0.002 * length))

    def seen_fraction(self) -> float:
        """Part of the surface area that the camera sees."""
        a, b, c = np.moveaxis(self.body.vertices[self.body.faces], 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        normals = texture.face_normals(self.body.vertices, self.body.faces)
        total = 0.0
        for weights in ((4, 1, 1), (1, 4, 1), (1, 1, 4), (2, 2, 2)):
            points = (weights[0] * a + weights[1] * b + weights[2] * c) / 6.0
            place = cameras.project(transforms.apply(self.camera_from_object, points), self.k)
            nearest = np.clip(np.round(place).astype(int), 0, np.array(self.seen.mask.shape)[::-1] - 1)
            lit = self.open(points, normals, 0.0) & self.seen.mask[nearest[:, 1], nearest[:, 0]]
            total += float((area * lit).sum()) / 4.0
        return total / float(area.sum())


def _filled(texels: texture.Texels, colours: np.ndarray, good: np.ndarray, seen: ObjectView) -> np.ndarray:
    """Colours (N, 3) where those that are not `good` are the mean of the nearest good ones with a like normal."""
    from scipy.spatial import cKDTree

    if not good.any():
        mask = seen.mask if seen.mask.any() else np.ones_like(seen.mask)
        return np.broadcast_to(np.median(seen.rgb.pixels[mask], axis=0), colours.shape).astype(np.float64)
    size = float(np.ptp(texels.points, axis=0).max())
    keys = np.concatenate([texels.points, 0.3 * size * texels.normals], axis=1)
    source = np.flatnonzero(good)[:: max(1, int(good.sum()) // 20000)]
    missing = np.flatnonzero(~good)
    number = min(24, len(source))
    nearest = cKDTree(keys[source]).query(keys[missing], k=number)[1].reshape(len(missing), number)
    result = colours.copy()
    result[missing] = colours[source][nearest].mean(axis=1)
    return result
