"""A baseline: the smallest upright box around the seen points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from dextera_build.artifacts.objects.object import Shape
from dextera_build.artifacts.objects.view import ObjectView, Seen
from dextera_build.geometry import lie, solids, transforms
from dextera_build.geometry.solids import Solid
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from . import baseline
from .evidence import Evidence

if TYPE_CHECKING:
    from .mesh import MeshOptions

BACKEND = Backend(
    summary="a baseline: the upright box with the smallest base around the seen points",
    packages=("open3d", "opencv-python-headless", "scipy"),
    extra="twin",
)

THINNEST_M = 0.002
"""Minimum edge of a box [m]."""


def complete(
    ctx: Context, view: ObjectView, measured: Measurements[Seen], common: MeshOptions, options: Options
) -> Shape:
    """Return the box that stands on the support and contains the middle 98 % of the points along each of its edges."""
    return baseline.shape_of(ctx, "bounding_box", measured, common, _box)


def _box(evidence: Evidence) -> Solid:
    points = evidence.points
    _, _, angle = cv2.minAreaRect(points[:, :2].astype(np.float32))
    turn = lie.about_z(np.radians(angle))
    low, high = np.quantile(points @ turn, [0.01, 0.99], axis=0)
    low[2] = min(0.0, high[2] - THINNEST_M)
    size = np.maximum(high - low, THINNEST_M)
    return solids.box(size, (low + high) / 2).moved(transforms.rigid(turn, np.zeros(3)))
