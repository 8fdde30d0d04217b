"""A corner of a room with boxes, painted with random rectangles: a scene for alignment, and captures of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.ndimage import gaussian_filter

from dextera_build.artifacts.cameras.camera import Camera, Capture, Measured, Photograph
from dextera_build.artifacts.cameras.image import DepthImage, Image
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import cameras, raycast, transforms
from dextera_build.geometry.lie import rotation

CAMERA = Camera(width=320, height=240, fx=280.0, fy=280.0, cx=159.5, cy=119.5)
SIDE = 512


@cache
def room(seed: int = 0, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """Floor, two walls and three boxes in the axes of a camera at the origin [m]; `shift` moves the first box."""
    sheets = [
        ((-2.0, 0.7, 0.5), (4.0, 0, 0), (0, 0, 3.5)),
        ((-2.0, -1.6, 3.5), (4.0, 0, 0), (0, 2.4, 0)),
        ((-1.6, -1.6, 0.5), (0, 0, 3.2), (0, 2.4, 0)),
    ]
    for number, (low, size) in enumerate(
        [((-0.2, 0.2, 1.8), (0.5, 0.5, 0.4)), ((0.6, 0.0, 2.4), (0.4, 0.7, 0.4)), ((-1.0, 0.3, 2.2), (0.5, 0.4, 0.5))]
    ):
        place = np.array(low) + (np.array(shift) if number == 0 else 0.0)
        x, y, z = np.diag(size)
        sheets += [(place, x, y), (place, x, z), (place, z, y), (place + x, z, y)]
    corners, uv = [], []
    for number, (origin, one, other) in enumerate(sheets):
        o, a, b = (np.array(each, float) for each in (origin, one, other))
        corners += [o, o + a, o + a + b, o + b]
        left, low = (number % 4) / 4, (number // 4) / 4
        uv.append([(left, low), (left + 0.25, low), (left + 0.25, low + 0.25), (left, low + 0.25)])
    quads = np.arange(len(corners)).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    each = np.array(uv)
    return Mesh(
        vertices=np.array(corners, np.float32),
        faces=faces.astype(np.int32),
        uv=np.concatenate([each[:, [0, 1, 2]], each[:, [0, 2, 3]]]).astype(np.float32),
        texture=Image(pixels=paint(seed)),
    )


def paint(seed: int) -> np.ndarray:
    """Random rectangles (4 SIDE, 4 SIDE, 3) uint8."""
    random = np.random.default_rng(seed)
    size = 4 * SIDE
    pixels = np.full((size, size, 3), 150, np.uint8)
    for _ in range(2500):
        left, top = random.integers(0, size, 2)
        wide, high = random.integers(12, 110, 2)
        pixels[top : top + high, left : left + wide] = random.integers(20, 235, 3)
    return np.asarray(gaussian_filter(pixels, (1.5, 1.5, 0)))


def scaled(mesh: Mesh, factor: float) -> Mesh:
    """The mesh in lengths of which one metre has `factor`."""
    return mesh.model_copy(update={"vertices": (mesh.vertices * factor).astype(np.float32)})


def motion(turn_deg: tuple[float, float, float], place: tuple[float, float, float]) -> np.ndarray:
    """T_room_camera."""
    return transforms.rigid(rotation(np.radians(turn_deg)), np.array(place))


def capture(mesh: Mesh, pose: np.ndarray, seed: int = 0, noise: float = 1.0) -> Capture:
    """What an RGB-D camera at `pose` (T_room_camera) takes, with noise of colours and of depth."""
    random, fine = np.random.default_rng(seed), CAMERA.scaled(2.0)
    texture = None if mesh.texture is None else mesh.texture.pixels
    surface = raycast.Surface(mesh.vertices, mesh.faces, mesh.uv, texture)
    seen = raycast.render([surface], fine.matrix(), pose, fine.height, fine.width)
    colours = raycast.shade([surface], seen).reshape(240, 2, 320, 2, 3).mean(axis=(1, 3))
    exact = raycast.render([surface], CAMERA.matrix(), pose, 240, 320).depth
    depth = exact + noise * 0.002 * exact**2 * random.normal(size=exact.shape)
    rgb = np.clip(colours + noise * 3 * random.normal(size=colours.shape), 0, 255).round().astype(np.uint8)
    depth = np.where(exact > 0, np.maximum(depth, 0.01), 0.0).astype(np.float32)
    photograph = Photograph(rgb=Image(pixels=rgb), camera=CAMERA)
    return Capture(photograph=photograph, measured=Measured(depth=DepthImage(depth=depth)))


def photographed(given: Capture, pixels: np.ndarray) -> Capture:
    """The capture with another picture (H, W, 3) uint8."""
    photograph = given.photograph.model_copy(update={"rgb": Image(pixels=pixels.astype(np.uint8))})
    return given.model_copy(update={"photograph": photograph})


def points(given: Capture) -> np.ndarray:
    """Measured points (N, 3) in the camera's frame [m]."""
    assert given.measured is not None
    depth = given.measured.depth.depth.astype(float)
    return cameras.backproject(depth, CAMERA.matrix())[depth > 0]
