"""The result of a backend of align.canonical."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.canonical import Open


@dataclass(frozen=True)
class Chosen:
    """Up and front of a body."""

    up: np.ndarray  # (3,) unit, along one of the own axes
    front: np.ndarray  # (3,) unit, along another one
    undecided: tuple[Open, ...]
    method: str
    by_colour: bool = False
    """Whether the front is determined by a picture on it, which the shape's symmetries do not preserve."""
    up_lead: float | None = None
    front_lead: float | None = None
