"""Surfaces from their front left and above."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.objects.object import Body
from dextera_build.artifacts.scenes.scene_description import SceneDescription
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import kinematics, transforms
from dextera_build.geometry.thumbnail import Paint, thumbnail


def _picture_of_mesh(mesh: Mesh) -> bytes:
    """The mesh from its front left and above."""
    return png(thumbnail([(mesh.vertices[mesh.faces], mesh.paint)]))


def _picture_of_body(body: Body) -> bytes:
    """All links, posed as in the photograph."""
    poses = kinematics.link_poses(body)
    meshes = ((poses[name], link.mesh) for name, link in body.links.items())
    parts = [(transforms.apply(pose, mesh.vertices)[mesh.faces], mesh.paint) for pose, mesh in meshes]
    return png(thumbnail(parts))


def _facts_of_scene_description(scene: SceneDescription) -> Iterator[str]:
    """Objects, joints, mass, geoms, cameras and robots."""
    parts = [body for thing in scene.objects for body in thing.links.values()]
    geoms = [*scene.static, *(geom for body in parts for geom in body.geoms)]
    listed = f" ({', '.join(scene.bodies)})" if 0 < len(scene.objects) < 7 else ""
    yield f"{len(scene.objects)} objects{listed}"
    yield f"{sum(len(thing.joints) for thing in scene.objects)} joints"
    yield f"{sum(body.inertia.mass_kg for body in parts):.3g} kg"
    yield f"{sum(geom.role == 'collision' for geom in geoms)} collision geoms"
    yield f"{len(scene.cameras)} cameras"
    yield from (f"robot {attachment.prefix}" for attachment in scene.attachments)


def _picture_of_scene_description(scene: SceneDescription) -> bytes:
    """All objects in the home keyframe; static collision geoms are left out."""
    return png(thumbnail(list(_seen(scene))))


def _seen(scene: SceneDescription) -> Iterator[tuple[np.ndarray, Paint]]:
    placed = [(np.eye(4), scene.static)]
    for thing in scene.objects:
        poses = thing.world_poses()
        placed += [(poses[part], body.geoms) for part, body in thing.links.items()]
    for pose, geoms in placed:
        for geom in geoms:
            if isinstance(geom.shape, Mesh):
                yield transforms.apply(pose, geom.vertices())[geom.shape.faces], geom.shape.paint


FACTS: Mapping[type[Artifact], Callable[[Any], Iterator[str]]] = {
    SceneDescription: _facts_of_scene_description,
}
PICTURES: Mapping[type[Artifact], Callable[[Any], bytes]] = {
    Mesh: _picture_of_mesh,
    Body: _picture_of_body,
    SceneDescription: _picture_of_scene_description,
}
