"""Terms: quantities that can be observed and recorded in a task, declared once as data in `declared`.

Observations, recordings, spaces of Gymnasium, features of LeRobot, topics and messages of ROS 2 recordings and the
table in the docs are generated from them. `Layout.terms` resolves a declaration for one robot, its objects and its
cameras. The function of a term has its name: in `seen` for a term that policies may see, in
`dextera_build.sim.runtime.privileged` for one that only critics may see.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from dextera_build.artifacts.robots.noise import ColourNoise, DepthNoise
from dextera_build.artifacts.tasks.term import TermSpec

Group = Literal["policy", "proprioception", "state", "contact", "goal", "privileged", "rgb", "depth", "cloud", "record"]
"""The nine modalities of Table I, and `record` for additional recorded data."""
Reader = Literal["policies", "critics", "data sets"]
"""Access to a term: `policies` unrestricted, `critics` only in a simulator, `data sets` only in recordings."""
Rows = Literal["joints", "objects", "displacement", "goal", "tips", "limbs", "points", "cameras", ""]
"""Meaning of the first axis of a term, or that there is one term per camera; empty: a single row."""


@dataclass(frozen=True)
class Sensor:
    """Sensor of a term; by default exact, without delay and in every control period.

    The value of a term with a sensor is the last one available, see `dextera_build.sim.observe.sensors`.
    """

    rate_hz: float | None = None
    """Measurements per second [Hz]; None: one in every control period."""
    delay_s: float = 0.0
    """Delay from a measurement to its availability [s]."""
    loss: float = 0.0
    """Probability that a measurement of numbers is lost, 0..1; the last one stays."""
    sigma: float = 0.0
    """Standard deviation of numbers in the term's unit, or of each coordinate of poses [m]."""
    turn_sigma_rad: float = 0.0
    """Standard deviation of the rotation of poses about each axis [rad]."""
    colour: ColourNoise | None = None
    """Noise of pictures."""
    depth: DepthNoise | None = None
    """Noise and holes of depth, and of the points made of it."""


EXACT = Sensor()


@dataclass(frozen=True)
class Declared:
    """Declaration of a term, common to all tasks."""

    name: str
    """Its name in observations and episodes, or a field of `Frame`."""
    group: Group
    """Its modality."""
    rows: Rows
    """Meaning of its first axis."""
    parts: tuple[str, ...]
    """Components of each row; empty: a row is one number."""
    unit: str
    """Unit of its numbers."""
    frame: str
    """Frame of its numbers; empty if there is none."""
    about: str
    """Its meaning."""
    dtype: str = "float32"
    """Type of its numbers."""
    seen_by: Reader = "policies"
    """Access."""
    feature: str = ""
    """Feature of a LeRobot data set; `{}` is the camera."""
    topic: str = ""
    """Topic of ROS 2; `{}` is the row or the camera."""
    message: str = ""
    """Type of its messages."""
    recorded: bool = False
    """Whether episodes hold its observed values."""

    @property
    def is_vector(self) -> bool:
        """Whether it is a vector channel: numbers that policies may see."""
        return self.seen_by == "policies" and self.rows != "cameras"


def added(spec: TermSpec) -> Declared:
    """The declaration of a term that does not come with dxb."""
    return Declared(
        spec.term,
        "state",
        spec.rows,  # type: ignore[arg-type]  # checked by `TermSpec`
        spec.parts,
        spec.unit,
        spec.frame,
        spec.about,
        feature=f"observation.{spec.term}",
        topic=f"/{spec.term}",
        message="std_msgs/Float64MultiArray",
        recorded=True,
    )


@dataclass(frozen=True)
class Term:
    """A term of one task."""

    declared: Declared
    """Its declaration."""
    names: tuple[str, ...]
    """Names of its rows; empty if they have none."""
    shape: tuple[int, ...]
    """Shape of one observation."""
    rate_hz: float
    """Measurements per second [Hz]."""
    sensor: Sensor = EXACT
    """Its delay and noise."""
    camera: str = ""
    """Its camera; empty if there is none."""

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
        """Names of its components, row by row: `mug.x`; rows of a single, nameless limb have no prefix."""
        if not self.declared.parts or not self.declared.rows:
            return self.declared.parts or self.names
        alone = self.declared.rows == "limbs" and len(self.names) == 1
        return tuple(part if alone else f"{name}.{part}" for name in self.names for part in self.declared.parts)

    def topic(self, row: str = "") -> str:
        """Its topic, or that of one of its rows; a robot with one limb has `/target/hand`."""
        if self.declared.rows == "limbs" and len(self.names) == 1:
            row = ""
        return self.declared.topic.format(self.camera or row).replace("//", "/")
