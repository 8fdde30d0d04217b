"""Backend stub of factorize.collision: one hull per link, with no dependencies."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.objects.object import Collision, Link, Pieces
from dextera_build.artifacts.shapes.mesh import Hull
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .collision import CollisionOptions

BACKEND = Backend(summary="one hull per link, for tests", profiles=("stub",))


def pieces(ctx: Context, link: Link, hollow: bool, common: CollisionOptions, options: Options) -> Pieces:
    """Known walls, otherwise the hull of the link's outermost corners, which closes any cavity."""
    if link.walls:
        return Pieces(hulls=link.walls, method="walls")
    return Pieces(hulls=(Hull(vertices=_outermost(link.mesh.vertices, common.corners)),), method="hull")


def picture(ctx: Context, collision: Collision, options: Options) -> None:
    """Draw nothing."""


def _outermost(vertices: np.ndarray, corners: int) -> np.ndarray:
    """Vertices farthest along the axes and along about `corners` directions spread over the sphere."""
    number = np.arange(corners) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * number / corners), np.pi * (1.0 + 5.0**0.5) * number
    spread = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    directions = np.concatenate([spread, np.eye(3), -np.eye(3), signs])
    return np.unique(vertices[np.argmax(vertices @ directions.T, axis=0)], axis=0)
