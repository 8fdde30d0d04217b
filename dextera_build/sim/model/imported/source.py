"""Result of reading a robot's description in any format."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

WHOLE = "world_base"
"""Link for everything that is fixed to the world: of several roots of a file, or of a root called `world`."""


@dataclass
class Source:
    """A robot's description."""

    spec: Any
    """The `mujoco.MjSpec`; its meshes are among `spec.assets`."""
    mimics: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    """Joint -> the joint that it follows, ratio and offset [rad or m]."""
    efforts: dict[str, float] = field(default_factory=dict)
    """Joint -> largest torque or force [N m or N]."""
    speeds: dict[str, float] = field(default_factory=dict)
    """Joint -> largest speed [rad/s or m/s]."""
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> stiffness and damping of its position actuator [N m/rad, N m s/rad]."""
    home: dict[str, float] = field(default_factory=dict)
    """Joint -> position in its first keyframe [rad or m]."""
    repaired: dict[str, str] = field(default_factory=dict)
    """Link -> its moments of inertia in the file, which no body has, and those that replace them [kg m^2]."""
    renamed: dict[str, str] = field(default_factory=dict)
    """Link -> its name in the robot model."""
    dropped: list[str] = field(default_factory=list)
    """Elements that a robot model cannot represent."""
