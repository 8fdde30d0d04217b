"""An upright box around the seen points: a fast placeholder without dependencies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import solids, transforms
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(summary="an upright box around the seen points, in the mean colour", profiles=("stub",))

SMALLEST_M = 0.005
"""Minimum edge length [m]."""


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: Options
) -> Shape:
    """Return the world-axis-aligned box of the middle 96 % of the seen points, from the support up."""
    seen = measured.needed()
    valid = seen.mask & (seen.depth > 0)
    if int(valid.sum()) < common.least_points:
        ctx.fail(
            f"the view has {int(valid.sum())} pixels with depth, {common.least_points} are needed",
            hint="lower `least_points`",
        )
    points = seen.world_points(valid)
    low, high = np.quantile(points, [0.02, 0.98], axis=0)
    size = np.maximum(high - low, SMALLEST_M)
    size[2] = max(high[2], SMALLEST_M)
    body = solids.box(size, (0.0, 0.0, size[2] / 2))
    vertices = body.vertices.astype(np.float32)
    colour = np.median(seen.rgb[valid], axis=0).astype(np.uint8)
    mesh = Mesh(
        vertices=vertices,
        faces=body.faces.astype(np.int32),
        uv=np.full((len(body.faces), 3, 2), 0.5, np.float32),
        texture=Image(pixels=np.broadcast_to(colour, (4, 4, 3)).copy()),
    )
    middle = (low + high) / 2
    place = transforms.rigid(np.eye(3), np.array([middle[0], middle[1], 0.0]))
    return Shape(
        mesh=mesh,
        walls=(Hull(vertices=vertices.copy()),),
        pose=Pose(parent="world", child="object", matrix=place),
        hypothesis="box",
        hollow=False,
        residual_m=0.0,
        mask_iou=0.0,
        unseen_fraction=0.5,
        scores={"box": 0.0},
    )
