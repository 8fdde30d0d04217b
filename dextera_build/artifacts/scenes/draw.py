"""Random reference scenes by index: objects on the table, the viewpoint of the camera, the quality of its depth.

The three parts are separate values, so that another viewpoint does not repeat the settling of the objects.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.base import Artifact

Contact: TypeAlias = Literal["apart", "touching", "piled"]
"""Degree of contact between objects: with gaps, side by side, or dropped onto and into one another."""


class Arrangement(Artifact):
    """The objects on a table."""

    seed: int
    """Seed of everything random about the table: objects, positions, surfaces, lights."""
    count: int
    """Number of objects that are dropped."""
    contact: Contact
    """Degree of contact."""


class Viewpoint(Artifact):
    """A camera that looks at the centre of the objects."""

    seed: int
    """Seed of its heading."""
    distance_m: float
    """Distance from the optical centre to the centre of the objects [m]."""
    pitch_deg: float
    """Angle of the line of sight below the horizon [deg]."""
    roll_deg: float
    """Rotation about the line of sight [deg]; 0 is upright, 90 a camera turned clockwise."""
    width_px: int
    """Width of the picture [px]; its height is three quarters of it."""

    @property
    def unit(self) -> float:
        """Units per metre of a scene generated from its picture; random from `seed`, 0.2 to 5, uniform in log."""
        return float(np.exp(np.random.default_rng((self.seed, 5)).uniform(-1, 1) * np.log(5.0)))


class Sensor(Artifact):
    """Quality of a depth stream."""

    seed: int
    """Seed of the noise."""
    noise: float
    """Factor on the noise of `reference.photograph`."""
    dropout: float
    """Fraction of the depth that is lost in patches, 0..1."""


class Draw(Artifact):
    """One photograph of one drawn scene."""

    arrangement: Arrangement
    """The objects on the table."""
    viewpoint: Viewpoint
    """The viewpoint."""
    sensor: Sensor
    """The quality of the depth."""
    axis: str = ""
    """The swept parameter, or empty."""
    value: str = ""
    """Its value in this draw, as in tables."""
