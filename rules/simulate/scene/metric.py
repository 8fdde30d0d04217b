"""A background in the unit of its support."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.cameras.image import DepthImage
from dextera_build.artifacts.scenes.scene import Background, SupportBox
from dextera_build.artifacts.shapes.mesh import Mesh


def metric(background: Background, factor: float) -> Background:
    """The background with all its lengths multiplied by `factor`, about the world's origin."""
    if factor == 1.0:
        return background
    invented = background.invented
    return background.model_copy(
        update={
            "depth": DepthImage(depth=(background.depth.depth * np.float32(factor))),
            "mesh": _mesh(background.mesh, factor),
            "invented": invented and _mesh(invented, factor),
            "boxes": tuple(_box(box, factor) for box in background.boxes),
        }
    )


def _mesh(mesh: Mesh, factor: float) -> Mesh:
    return mesh.model_copy(update={"vertices": (mesh.vertices.astype(np.float64) * factor).astype(np.float32)})


def _box(box: SupportBox, factor: float) -> SupportBox:
    lengths = {name: tuple(factor * v for v in getattr(box, name)) for name in ("centre", "half_size")}
    return box.model_copy(update=lengths)
