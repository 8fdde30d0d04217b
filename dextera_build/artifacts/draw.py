"""Reference scenes that are drawn by index: what is on the table, from where a camera sees it, how good its depth is.

The three parts are values of their own, so that a camera that moved settles nothing again.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from dextera_build.artifacts.base import Artifact

Contact: TypeAlias = Literal["apart", "touching", "piled"]
"""How close objects lie: with gaps, side by side, or dropped onto and into one another."""


class Arrangement(Artifact):
    """Which things are on which table."""

    seed: int
    """Seed of everything that is drawn for the table: things, places, surfaces, lights."""
    count: int
    """Number of things that are let fall."""
    contact: Contact
    """How close they lie."""


class Viewpoint(Artifact):
    """A camera that looks at the middle of the things."""

    seed: int
    """Seed of its heading."""
    distance_m: float
    """From the optical centre to the middle of the things [m]."""
    pitch_deg: float
    """Angle of the line of sight below the horizon [deg]."""
    roll_deg: float
    """Rotation about the line of sight [deg]; 0 is upright, 90 a camera turned clockwise."""
    width_px: int
    """Width of the picture [px]; its height is three quarters of it."""

    @property
    def unit(self) -> float:
        """Lengths per metre of a scene generated from its picture; drawn with `seed`, 0.2 to 5, uniform in log."""
        return float(np.exp(np.random.default_rng((self.seed, 5)).uniform(-1, 1) * np.log(5.0)))


class Sensor(Artifact):
    """Quality of a depth stream."""

    seed: int
    """Seed of the noise."""
    noise: float
    """Factor on the noise of `capture.reference`."""
    dropout: float
    """Part of the depth that is lost in patches, 0..1."""


class Draw(Artifact):
    """One photograph of one drawn scene."""

    arrangement: Arrangement
    """What is on the table."""
    viewpoint: Viewpoint
    """From where it is seen."""
    sensor: Sensor
    """How well its depth is measured."""
    axis: str = ""
    """The quantity that is swept, or empty."""
    value: str = ""
    """Its value in this draw, as in tables."""
