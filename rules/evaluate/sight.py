"""Views of true objects and a twin's assets, and their surfaces in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.object import Asset, Support
from dextera_build.artifacts.scene import Truth
from dextera_build.geometry import kinematics, raycast, transforms


@dataclass(frozen=True)
class Seen:
    """The visible mask of one object, and its whole surface in the camera frame."""

    mask: np.ndarray  # (H, W) bool
    vertices: np.ndarray  # (V, 3) float64 [m]
    faces: np.ndarray  # (F, 3)


def true_objects(truth: Truth) -> dict[str, Seen]:
    """True objects by name, in the camera frame."""
    camera_from_world = truth.camera_pose.inverse().matrix
    return {
        name: Seen(
            truth.labels.labels == thing.label,
            transforms.apply(camera_from_world, thing.mesh.vertices.astype(np.float64)),
            thing.mesh.faces,
        )
        for name, thing in truth.objects.items()
    }


def render_assets(
    assets: Collection[Asset], support: Support, camera: Camera
) -> tuple[dict[str, Seen], np.ndarray, np.ndarray]:
    """Assets by label, and the twin's colours (H, W, 3) uint8 and depth (H, W) [m], all in the camera frame."""
    camera_from_world = support.camera_pose.inverse()
    surfaces: list[raycast.Surface] = []
    owners: list[int] = []
    for number, asset in enumerate(assets.items.values()):
        poses = kinematics.link_poses(asset.body)
        for link, part in asset.body.links.items():
            matrix = (camera_from_world @ asset.pose).matrix @ poses[link]
            vertices = transforms.apply(matrix, part.mesh.vertices.astype(np.float64))
            texture = part.mesh.texture.pixels if part.mesh.texture is not None else None
            surfaces.append(raycast.Surface(vertices, part.mesh.faces, part.mesh.uv, texture, part.mesh.colour))
            owners.append(number)
    seen = raycast.render(surfaces, camera.matrix(), np.eye(4), camera.height, camera.width)
    owner = np.array([*owners, -1])[seen.index]
    found = {
        label: _joined(owner == number, [s for s, o in zip(surfaces, owners, strict=True) if o == number])
        for number, label in enumerate(assets.items)
    }
    return found, raycast.shade(surfaces, seen), seen.depth


def _joined(mask: np.ndarray, surfaces: list[raycast.Surface]) -> Seen:
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
    return Seen(mask, np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces))
