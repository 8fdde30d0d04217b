"""Terms: what can be observed and recorded in a task, declared once as data in `declared`.

Spaces of Gymnasium, features of LeRobot, topics and messages of ROS 2 recordings and the table in the docs follow from
them. `Layout.terms` resolves a declaration for one robot, its objects and its cameras.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from dextera_build.artifacts.noise import ColourNoise, DepthNoise

Group = Literal["policy", "proprioception", "state", "contact", "goal", "privileged", "rgb", "depth", "cloud", "record"]
"""The nine modalities of Table I, and `record` for what data sets hold beside observations."""
Reader = Literal["policies", "critics", "data sets"]
"""Who may see a term: `policies` everybody, `critics` only what has a simulator, `data sets` nobody while it runs."""
Rows = Literal["joints", "objects", "displacement", "goal", "tips", "limbs", "points", "cameras"]
"""What the first axis of a term counts, or that there is one term per camera."""


@dataclass(frozen=True)
class Sensor:
    """How a term is measured; by default exactly, at once and in every control period.

    A term that has a sensor is what the sensor reported last, see `dextera_build.sim.observe.sensors`.
    """

    rate_hz: float | None = None
    """Measurements per second [Hz]; None: one in every control period."""
    delay_s: float = 0.0
    """Time from a measurement to its arrival [s]."""
    sigma: float = 0.0
    """Standard deviation of numbers in the term's unit, of poses that of each coordinate [m]."""
    turn_sigma_rad: float = 0.0
    """Standard deviation of the rotation of poses about each axis [rad]."""
    colour: ColourNoise | None = None
    """Noise of pictures."""
    depth: DepthNoise | None = None
    """Noise and holes of depth, and of the points made of it."""


EXACT = Sensor()


@dataclass(frozen=True)
class Declared:
    """A term as it is in every task."""

    name: str
    """Field of its observation type, of `Frame` or of `Episode`."""
    group: Group
    """Its modality."""
    rows: Rows
    """What its first axis counts."""
    parts: tuple[str, ...]
    """Components of each row; empty: a row is one number."""
    unit: str
    """Unit of its numbers."""
    frame: str
    """Frame of its numbers; empty where there is none."""
    about: str
    """Its meaning."""
    dtype: str = "float32"
    """Type of its numbers."""
    seen_by: Reader = "policies"
    """Who may see it."""
    feature: str = ""
    """Feature of a LeRobot data set that holds it; `{}` is the camera."""
    topic: str = ""
    """Topic of ROS 2; `{}` is the row or the camera."""
    message: str = ""
    """Type of its messages."""


@dataclass(frozen=True)
class Term:
    """A term of one task."""

    declared: Declared
    """What it is in every task."""
    names: tuple[str, ...]
    """Rows by name; empty where they have none."""
    shape: tuple[int, ...]
    """Shape of one observation."""
    rate_hz: float
    """Measurements per second [Hz]."""
    sensor: Sensor = EXACT
    """Its delay and noise."""
    camera: str = ""
    """Its camera; empty where there is none."""

    @cached_property
    def key(self) -> str:
        """Its name in observations of Gymnasium: `deployable/joints`, `deployable/depth/workspace`."""
        side = "deployable" if self.declared.seen_by == "policies" else "privileged"
        return "/".join(part for part in (side, self.declared.name, self.camera) if part)

    @property
    def feature(self) -> str:
        """Its feature in a LeRobot data set; empty if it is not recorded."""
        return self.declared.feature.format(self.camera)

    @property
    def components(self) -> tuple[str, ...]:
        """Names of its numbers, row by row: `mug.x`; rows of a single, nameless limb have none."""
        if not self.declared.parts:
            return self.names
        alone = self.declared.rows == "limbs" and len(self.names) == 1
        return tuple(part if alone else f"{name}.{part}" for name in self.names for part in self.declared.parts)

    def topic(self, row: str = "") -> str:
        """Its topic, or that of one of its rows; a robot with one limb has `/target/hand`."""
        if self.declared.rows == "limbs" and len(self.names) == 1:
            row = ""
        return self.declared.topic.format(self.camera or row).replace("//", "/")
