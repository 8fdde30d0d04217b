"""Backend stub of factorize.articulate: two boxes and a hinge, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Body, Joint, Link, Shape
from dextera_build.artifacts.objects.view import Seen, State
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements
from .parts import Parts

if TYPE_CHECKING:
    from .articulate import ArticulateOptions

BACKEND = Backend(summary="two boxes and a hinge at the back, for tests", profiles=("stub",))

_CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)
_FACES = np.array(
    [0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5],
    np.int32,
).reshape(-1, 3)


def parts(
    ctx: Context,
    shape: Shape,
    measured: Measurements[Seen],
    again: State | None,
    common: ArticulateOptions,
    options: Options,
) -> Parts:
    """The lowest tenth of the bounding box as base and an equal box as lid, open by 90 degrees."""
    low, high = shape.mesh.vertices.min(axis=0).astype(np.float64), shape.mesh.vertices.max(axis=0).astype(np.float64)
    height = 0.1 * float(high[2] - low[2])
    top = low[2] + height
    joint = Joint(
        name="hinge",
        type="revolute",
        parent="base",
        child="lid",
        origin=(float(low[0] + high[0]) / 2.0, float(high[1]), float(top)),
        axis=(-1.0, 0.0, 0.0),
        lower=0.0,
        upper=common.upper_rad,
        position=float(np.pi / 2.0),
    )
    base = _box(shape.mesh, low, np.array([high[0], high[1], top]))
    lid = _box(shape.mesh, np.array([low[0], low[1], top]), np.array([high[0], high[1], top + height]))
    return Parts({"base": base, "lid": lid}, (joint,))


def picture(ctx: Context, body: Body, seen: Seen, options: Options) -> None:
    """Draw nothing."""


def _box(like: Mesh, low: np.ndarray, high: np.ndarray) -> Link:
    vertices = (low + _CORNERS * (high - low)).astype(np.float32)
    return Link(mesh=Mesh(vertices=vertices, faces=_FACES, colour=like.colour), walls=(Hull(vertices=vertices),))
