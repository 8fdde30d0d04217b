"""Things for drawn worlds, made by hand."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.scenes.world import Matter, Part, Thing
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import solids


def block(size: tuple[float, float, float], colour: tuple[float, float, float] = (0.8, 0.2, 0.2)) -> Thing:
    """A solid box, the middle of its base at the origin [m]."""
    body = solids.box(size, (0.0, 0.0, size[2] / 2))
    mesh = Mesh(vertices=body.vertices.astype(np.float32), faces=body.faces.astype(np.int32), colour=colour)
    return Thing(
        parts={"part_0": Part(mesh=mesh, pieces=(Hull(vertices=mesh.vertices),))},
        surface=mesh,
        pose=Pose(parent="reference", child="thing", matrix=np.eye(4)),
        matter=Matter(mass_kg=0.2, friction=0.5),
    )


def blocks(count: int) -> dict[str, Thing]:
    """Boxes of different sizes."""
    return {f"block_{n}": block((0.05 + 0.005 * n, 0.04 + 0.004 * n, 0.03 + 0.01 * n)) for n in range(count)}
