"""Backend stub of align.canonical: the body's own axes."""

from __future__ import annotations

import numpy as np

from dextera_build.rule import Backend, Context, Options

from .bodies import Surface
from .chosen import Chosen

BACKEND = Backend(summary="the body's own z and x, for tests", profiles=("stub",))


def choose(ctx: Context, surface: Surface, seen_up: np.ndarray | None, options: Options) -> Chosen:
    """Z and x, undecided."""
    return Chosen(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), ("up", "front"), "own axes, unchecked")
