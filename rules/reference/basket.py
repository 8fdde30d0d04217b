"""A basket of coiled rope in a reference world."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import PositiveFloat, model_validator

from dextera_build.artifacts.scenes.world import Part
from dextera_build.rule import Fraction

from . import solids, textures, walls
from .on_table import Placed

STEPS = 4
"""Points of the outside per coil."""


class Basket(Placed):
    """A round basket of coiled rope, open at the top: a flat floor, and a wall that leans outwards.

    The rope bulges on both sides of the wall. Contacts are with a smooth wall through the crests of the bulges.
    """

    kind: Literal["basket"]
    mass_kg: PositiveFloat = 0.35
    """Mass [kg]."""
    radius_m: PositiveFloat = 0.115
    """Outer radius at the rim [m]."""
    foot_radius_m: PositiveFloat = 0.095
    """Outer radius at the foot [m]."""
    height_m: PositiveFloat = 0.105
    """Height [m]."""
    rope_m: PositiveFloat = 0.006
    """Thickness of the rope, and so of the wall and of the floor [m]."""
    coil_m: PositiveFloat = 0.010
    """Height of a coil [m]."""
    seam_m: PositiveFloat = 0.0008
    """Depth of the seams between coils, on either side of the wall [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.72, 0.60, 0.40)
    """Colour of the rope, sRGB."""
    seam: tuple[Fraction, Fraction, Fraction] = (0.52, 0.42, 0.27)
    """Colour of the seams, sRGB."""

    @model_validator(mode="after")
    def _hollow(self) -> Basket:
        if self.rope_m >= min(self.radius_m, self.foot_radius_m, self.height_m):
            raise ValueError("the rope is as thick as the basket; make `rope_m` smaller")
        if 2 * self.seam_m >= self.rope_m:
            raise ValueError("the seams cut the rope; make `seam_m` less than half of `rope_m`")
        return self

    def parts(self) -> dict[str, Part]:
        """The wall with its floor."""
        coils = max(1, round((self.height_m - self.rope_m) / self.coil_m))
        seams = tuple(self._seam(number, coils) for number in range(coils))
        picture = textures.banded(textures.plain(768, 1536, self.colour, 0.06, 40, self.seed), seams)
        shell = solids.turned(self._profile(self.seam_m, STEPS * coils, coils), picture)
        return {"shell": Part(mesh=shell, gloss=0.1, pieces=walls.vessel(self._profile(0.0, 2, coils)))}

    def _profile(self, seam_m: float, count: int, coils: int) -> np.ndarray:
        """Radius and height (P, 2) [m], from the axis at the bottom over the rim to the axis at the floor."""
        part = np.linspace(0.0, 1.0, count + 1)
        heights = self.rope_m + part * (self.height_m - self.rope_m)
        crests = self.foot_radius_m + (heights / self.height_m) * (self.radius_m - self.foot_radius_m)
        inset = seam_m * (1.0 - np.cos(2 * np.pi * coils * part)) / 2
        outer = np.c_[crests - inset, heights]
        inner = np.c_[crests - self.rope_m + inset, heights][::-1]
        foot = [[0.0, 0.0], [self.foot_radius_m, 0.0]]
        rim = (outer[-1] + inner[0]) / 2 + [0.0, 0.001]
        return np.concatenate([foot, outer, [rim], inner, [[0.0, self.rope_m]]])

    def _seam(self, number: int, coils: int) -> tuple[float, float, tuple[float, float, float]]:
        """The band of the picture along a seam of the outside."""
        profile = self._profile(0.0, 2, coils)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
        low, high = length[2] / length[-1], length[4] / length[-1]
        middle, half = low + (high - low) * (number + 0.5) / coils, 0.12 * (high - low) / coils
        return float(middle - half), float(middle + half), self.seam
