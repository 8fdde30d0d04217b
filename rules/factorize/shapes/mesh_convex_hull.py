"""A baseline: the convex hull of the seen points and of their projections onto the support."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.geometry import convex
from dextera_build.geometry.solids import Solid
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import baseline
from .evidence import Evidence
from .standing_hull import with_feet

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="a baseline: the convex hull of the seen points, down to the support",
    packages=("open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: Options
) -> Shape:
    """Return the hull of all trusted points and of their projections onto the support."""
    return baseline.shape_of(ctx, "convex_hull", measured, common, hull)


def hull(evidence: Evidence) -> Solid:
    """The convex hull of the seen points and of their projections onto the support."""
    vertices, faces = convex.surface(with_feet(evidence.points))
    return Solid(vertices.astype(np.float64), faces.astype(np.int64))
