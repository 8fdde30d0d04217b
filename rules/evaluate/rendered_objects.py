"""Renderings of true objects and of a twin's bodies, and their surfaces in the camera frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.objects.object import Body, Placement, Support
from dextera_build.artifacts.scenes.scene import Truth
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


def placed_bodies(
    bodies: Collection[Body], placements: Collection[Placement], support: Support
) -> dict[str, list[raycast.Surface]]:
    """Surfaces of each body's links by label, scaled and posed as `simulate.asset` does, in the camera frame [m].

    Bodies without a placement are left out.
    """
    camera_from_world = support.camera_pose.inverse().matrix
    return {
        label: _links(body, placements.items[label], camera_from_world, support.factor)
        for label, body in bodies.items.items()
        if label in placements.items
    }


def _links(body: Body, placement: Placement, camera_from_world: np.ndarray, factor: float) -> list[raycast.Surface]:
    poses, surfaces = kinematics.link_poses(body), []
    pose = placement.pose.matrix.copy()
    pose[:3, 3] *= factor
    for link, part in body.links.items():
        own = transforms.apply(poses[link], part.mesh.vertices.astype(np.float64)) * (placement.scale * factor)
        vertices = transforms.apply(camera_from_world @ pose, own)
        texture = part.mesh.texture.pixels if part.mesh.texture is not None else None
        surfaces.append(raycast.Surface(vertices, part.mesh.faces, part.mesh.uv, texture, part.mesh.colour))
    return surfaces


def render(things: dict[str, list[raycast.Surface]], camera: Camera) -> tuple[dict[str, Seen], np.ndarray, np.ndarray]:
    """Label map of the objects, their colours (H, W, 3) uint8 and their depth (H, W) [m] in the camera."""
    surfaces = [surface for own in things.values() for surface in own]
    owners = [number for number, own in enumerate(things.values()) for _ in own]
    seen = raycast.render(surfaces, camera.matrix(), np.eye(4), camera.height, camera.width)
    owner = np.array([*owners, -1])[seen.index]
    found = {label: _joined(owner == number, own) for number, (label, own) in enumerate(things.items())}
    return found, raycast.shade(surfaces, seen), seen.depth


def visible_fraction(thing: Seen, camera: Camera) -> float:
    """Visible fraction of an object's outline, neither hidden by other objects nor outside the picture, 0..1.

    The outline is rendered in a picture twice as wide and high, at half the resolution.
    """
    half = Camera(
        width=camera.width,
        height=camera.height,
        fx=camera.fx / 2,
        fy=camera.fy / 2,
        cx=camera.cx / 2 + camera.width / 4,
        cy=camera.cy / 2 + camera.height / 4,
    )
    surface = raycast.Surface(thing.vertices, thing.faces)
    whole = raycast.render([surface], half.matrix(), np.eye(4), half.height, half.width).index >= 0
    return min(1.0, float(thing.mask.sum()) / max(1.0, 4.0 * float(whole.sum())))


def touches_border(mask: np.ndarray) -> bool:
    """Whether a mask (H, W) touches the border of the picture, so that its object may be cut."""
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def counted(things: dict[str, Seen], camera: Camera, least_visible: float, *, whole: bool) -> dict[str, float]:
    """Visible fraction of the objects that are expected to be found.

    Args:
        things: True objects.
        camera: Intrinsics.
        least_visible: Minimum visible fraction of an object's outline.
        whole: Leave out objects cut by the picture's border, which parsing treats as static (row B2).
    """
    parts = {name: visible_fraction(thing, camera) for name, thing in things.items()}
    return {
        name: part
        for name, part in parts.items()
        if part >= least_visible and not (whole and touches_border(things[name].mask))
    }


def _joined(mask: np.ndarray, surfaces: list[raycast.Surface]) -> Seen:
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    faces = [surface.faces + start for surface, start in zip(surfaces, starts[:-1], strict=True)]
    return Seen(mask, np.concatenate([surface.vertices for surface in surfaces]), np.concatenate(faces))
