"""Tasks that are proposed for the objects of a twin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Shape:
    """An object of a twin."""

    joints: Mapping[str, tuple[float, float, float]]
    """Joint -> position in the photograph, lower and upper limit [rad or m]."""
    size_m: np.ndarray
    """Extents (3,) in the world's axes [m]."""
    cavity_m: np.ndarray | None = None
    """Extents (3,) of its cavity [m]; None if nothing stays in it."""

    def fits_into(self, other: Shape) -> bool:
        """Whether it is smaller than the cavity of another object."""
        room = other.cavity_m
        return room is not None and bool((np.sort(self.size_m)[::-1] < np.sort(room)[::-1]).all())


@dataclass(frozen=True)
class Proposal:
    """A task that an object allows."""

    name: str
    """`PlaceMugInBasket`."""
    options: Mapping[str, str] = field(default_factory=dict)
    """Options of the goal, as YAML."""
    holds: bool = False
    """Whether a hand has to hold the object; no robot whose limbs only push gets it."""


def camel(label: str) -> str:
    """`BlackLaptop` for `black_laptop`."""
    return "".join(part.capitalize() for part in label.split("_"))
