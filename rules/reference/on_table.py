"""Common properties of all objects on the table of a reference world."""

from __future__ import annotations

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveFloat

from dextera_build.artifacts.scenes.world import Hinge, Matter
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Options


class Placed(Options):
    """Properties of every object on the table."""

    at_m: tuple[float, float]
    """x and y of the centre on the table [m]."""
    yaw_deg: float = 0.0
    """Rotation about z [deg]."""
    seed: NonNegativeInt = 0
    """Seed of the textures."""
    mass_kg: PositiveFloat = 0.3
    """Mass [kg]."""
    friction: PositiveFloat = 0.45
    """Sliding friction coefficient."""
    restitution: float = Field(0.15, ge=0.0, lt=1.0)
    """Coefficient of restitution of a slow impact on the table."""

    def matter(self) -> Matter:
        """Mechanical properties."""
        return Matter(mass_kg=self.mass_kg, friction=self.friction, restitution=self.restitution)

    def hinge(self) -> Hinge | None:
        """The hinge, if any."""
        return None

    def pose(self) -> np.ndarray:
        """T_world_thing, (4, 4), standing on z = 0."""
        return transforms.rigid(lie.about_z(np.radians(self.yaw_deg)), np.array([*self.at_m, 0.0]))
