"""Backend stub of align.matches: the same grid in both pictures, for tests."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .matches import MatchesOptions

BACKEND = Backend(summary="the same grid in both pictures, for tests", profiles=("stub",))


def match(ctx: Context, first: Image, second: Image, common: MatchesOptions, options: Options) -> Matches:
    """Nine points that are inside both pictures."""
    height, width = np.minimum(first.pixels.shape[:2], second.pixels.shape[:2])
    column, row = np.meshgrid(np.linspace(0, width - 1, 3), np.linspace(0, height - 1, 3))
    grid = np.stack([column.reshape(-1), row.reshape(-1)], axis=1)
    return Matches(first=grid, second=grid, confidence=np.ones(len(grid), np.float32), method="grid")
