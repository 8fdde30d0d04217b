"""background.expand without a model: ray casting of the textured surface and, behind it, the panorama."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.panorama import Panorama
from dextera_build.artifacts.cameras.views import Views, encoded
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.trajectory import Trajectory
from dextera_build.geometry import cameras as pinhole
from dextera_build.geometry import raycast
from dextera_build.rule import Backend, Context, Options

from ..pieces import BORDER_PX
from .cameras import ordered
from .gather import Look, together
from .sphere import sampled

BACKEND = Backend(
    summary="the measured surface by ray casting, the panorama on a sphere behind it",
    profiles=("cpu",),
    packages=("open3d", "opencv-python-headless"),
    extra="twin",
)


class WarpOptions(Options):
    """Options of backend `warp` of background.expand."""

    backdrop_m: PositiveFloat = 10.0
    """Radius of the sphere around the photograph's position with the panorama, beyond every surface [m]."""
    invented: bool = False
    """Whether surfaces without a visible pixel are included; they hide the panorama."""


def expand(
    ctx: Context,
    panorama: Panorama,
    paths: Collection[Trajectory],
    background: Background,
    camera: Camera,
    options: WarpOptions,
) -> Views:
    """The surface of the background in each camera; hidden surfaces are not inpainted.

    Rays without a surface hit a sphere with the panorama. All views show the same geometry, so they are consistent.
    Each pixel whose surface no earlier view shows becomes a point; its attribute `measured` is 0 on the sphere, and
    `footprint` is the distance of neighbouring pixels there [m].
    """
    eye = panorama.pose.matrix[:3, 3]
    meshes = [background.mesh, background.invented if options.invented else None]
    surfaces = [_surface(mesh, camera) for mesh in meshes if mesh is not None]
    farthest = max(float(np.linalg.norm(each.vertices - eye, axis=1).max()) for each in surfaces)
    radius = max(options.backdrop_m, 1.05 * farthest)
    looks, images = [], {}
    for name, pose in ordered(paths, eye).items():
        looks.append(_look(surfaces, panorama, radius, camera, pose))
        images[name] = encoded(looks[-1].pixels)
        ctx.progress(len(looks), sum(len(path.stamps) for path in paths.items.values()), "views")
    ctx.metric("without surface", 100.0 * float(np.mean([~look.measured for look in looks])), "%")
    return Views(
        images=images,
        names=tuple(images),
        camera=("1",) * len(images),
        cameras={"1": camera},
        poses=np.array([look.pose for look in looks]),
        points=together(looks, camera),
    )


def _surface(mesh: Mesh, camera: Camera) -> raycast.Surface:
    """The surface with a texture that is no finer than the pictures, so that no texel is skipped."""
    texture = None if mesh.texture is None else mesh.texture.pixels
    width = camera.width + 2 * BORDER_PX
    if texture is not None and texture.shape[1] > width:
        size = (width, max(1, round(texture.shape[0] * width / texture.shape[1])))
        texture = np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA))
    return raycast.Surface(mesh.vertices.astype(np.float64), mesh.faces, mesh.uv, texture, mesh.colour)


def _look(surfaces: list[raycast.Surface], panorama: Panorama, radius: float, camera: Camera, pose: np.ndarray) -> Look:
    """Result of ray casting from one camera."""
    k = camera.matrix()
    shown = raycast.render(surfaces, k, pose, camera.height, camera.width)
    hit = shown.index >= 0
    rays = pinhole.rays(camera.height, camera.width, k) @ pose[:3, :3].T
    place = panorama.pose.matrix
    # |start + depth * ray| = radius, from inside the sphere.
    start = pose[:3, 3] - place[:3, 3]
    along, square = rays @ start, (rays**2).sum(axis=-1)
    behind = (np.sqrt(along**2 + square * (radius**2 - start @ start)) - along) / square
    outwards = (start + behind[..., None] * rays) / radius
    backdrop = sampled(panorama.image.pixels, outwards @ place[:3, :3])
    return Look(
        pose=pose,
        pixels=np.where(hit[..., None], raycast.shade(surfaces, shown), backdrop),
        depth=np.where(hit, shown.depth, behind),
        normal=np.where(hit[..., None], shown.normal, -outwards),
        measured=hit,
    )
