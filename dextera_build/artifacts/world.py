"""Reference worlds: simulated workspaces with known truth, which stand in for real ones."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.camera import Camera
from dextera_build.artifacts.geometry import Mesh


class Lamp(Value):
    """A light that shines on the whole world from one direction."""

    direction: tuple[float, float, float]
    """Where the light goes."""
    strength: float
    """Diffuse intensity, 1 lights a facing white surface fully."""
    shadow: bool = False
    """Whether it throws shadows."""


class Part(Artifact):
    """One textured piece of a thing."""

    mesh: Mesh
    """Closed surface in the thing's frame."""
    gloss: float = 0.0
    """Strength of highlights, 0..1."""


class Thing(Artifact):
    """A thing of a reference world."""

    parts: dict[str, Part]
    """Textured pieces; they may overlap where one is fastened to another."""
    surface: Mesh
    """The closed outer surface of all pieces together, in the thing's frame."""
    world_from_thing: Annotated[np.ndarray, Array("4 4", "float64", unit="m", frame="world")]
    """T_world_thing."""


class RobotStand(Value):
    """Where a robot stands and how it holds itself."""

    position: tuple[float, float, float]
    """Origin of the robot's base [m]."""
    yaw: float
    """Rotation of the base about world z [rad]."""
    joints: dict[str, float]
    """Joint -> position [rad or m]; joints left out stand at home."""


class World(Artifact):
    """A reference world. Its frame: z up, the table's top is z = 0."""

    objects: dict[str, Thing]
    """What stands on the table, by name; the truth knows these."""
    fixtures: dict[str, Thing]
    """Table, pedestal, floor, wall: everything else but the robot."""
    lamps: tuple[Lamp, ...]
    """Lights."""
    ambient: float
    """Intensity of the light that comes from everywhere, 0..1."""
    stand: RobotStand | None = None
    """The robot's place, or None where there is none."""
    camera: Camera
    """Intrinsics."""
    world_from_camera: Annotated[np.ndarray, Array("4 4", "float64", unit="m", frame="world")]
    """T_world_camera, OpenCV axes."""
