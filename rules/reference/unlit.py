"""Ray-cast a reference world without lights, for the stub backends."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import World
from dextera_build.geometry import raycast, transforms
from dextera_build.sim.render.shot import Shot


def unlit(world: World) -> Shot:
    """Nearest texels, image-plane depth and labels 1, 2, ... in the order of `world.objects`; fixtures are 0."""
    surfaces: list[raycast.Surface] = []
    labels: list[int] = []
    things = [(0, thing) for thing in world.fixtures.values()]
    things += list(enumerate(world.objects.values(), start=1))
    for label, thing in things:
        for part in thing.parts.values():
            mesh = part.mesh
            vertices = transforms.apply(thing.pose.matrix, mesh.vertices.astype(np.float64))
            texture = mesh.texture.pixels if mesh.texture is not None else None
            surfaces.append(raycast.Surface(vertices, mesh.faces, mesh.uv, texture, mesh.colour))
            labels.append(label)
    camera = world.camera
    seen = raycast.render(surfaces, camera.matrix(), world.camera_pose.matrix, camera.height, camera.width)
    owner = np.array([*labels, 0], np.int32)
    return Shot(raycast.shade(surfaces, seen) / 255.0, seen.depth, owner[seen.index])
