"""Bodies rendered by MuJoCo among 3D Gaussians, composed by depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.gaussians import splatting
from dextera_build.gaussians.arrays import Gaussians
from dextera_build.sim.render import rendering


@dataclass(frozen=True)
class Drawn:
    """Rendering of some bodies."""

    rgb: np.ndarray  # (H, W, 3) uint8 sRGB
    depth_m: np.ndarray  # (H, W) float64 image-plane depth; inf without such a body
    owner: np.ndarray  # (H, W) int32, index of the body; -1 without such a body


def drawn(model: Any, data: Any, bodies: tuple[str, ...], camera: Camera, world_from_camera: np.ndarray) -> Drawn:
    """Render a state, and keep the pixels of the given bodies and their descendants.

    Args:
        model: Compiled model.
        data: Its state, after `mj_forward`.
        bodies: Names of children of the world.
        camera: Intrinsics [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
    """
    with rendering.Eye(model, camera, world_from_camera) as eye:
        rgb, depth, geoms = eye.rgb(data), eye.depth(data), eye.segmentation(data)
    owner = rendering.owners_of(model, geoms, bodies)
    return Drawn(rgb, np.where(owner >= 0, depth.astype(np.float64), np.inf), owner)


def among(bodies: Drawn, room: Gaussians, camera: Camera, world_from_camera: np.ndarray) -> np.ndarray:
    """The bodies in a room of Gaussians, (H, W, 3) uint8 sRGB.

    Each Gaussian is tested against the body in each pixel by the depth of its mean; Gaussians in front of it are
    alpha-blended over it. Pixels without a body have a black background.

    Args:
        bodies: Rendering of the bodies by the same camera.
        room: In the world frame of the model.
        camera: Intrinsics [px].
        world_from_camera: (4, 4) T_world_camera, OpenCV axes.
    """
    behind = np.where(bodies.owner[..., None] >= 0, bodies.rgb / 255.0, 0.0)
    size = (camera.height, camera.width)
    light = splatting.render(
        room, camera.matrix(), world_from_camera, size, paper=behind, paper_m=bodies.depth_m, near_m=0.01
    )
    return np.asarray(np.round(255 * light.clip(0, 1)).astype(np.uint8))
