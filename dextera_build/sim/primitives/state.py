"""The state by which a task is judged, measured the same way in every world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class GraspState:
    """The hold on the task's object in one control period."""

    fingers: int = 0
    """Fingers, the palm counted as one, that press on the object."""
    opposing: bool = False
    """Whether two of the forces on the object point against one another."""
    supported: bool = True
    """Whether anything but the hand touches the object."""
    slip_m_s: float = 0.0
    """Speed of the object relative to the palm [m/s]."""


@dataclass(frozen=True)
class TaskState:
    """One control period of a task, as its success is judged."""

    time_s: float
    """Since the start of the episode [s]."""
    world_from_object: np.ndarray
    """T_world_object of the task's object (4, 4)."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Joint of the task's object -> position [rad or m]."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> limits [rad or m]."""
    speeds: Mapping[str, float] = field(default_factory=dict)
    """Joint -> velocity [rad/s or m/s]."""
    grasp: GraspState = GraspState()
    """The hold on the object."""
