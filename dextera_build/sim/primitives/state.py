"""The state that determines success, measured the same way in every world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class GraspState:
    """Grasp state of the task's object in one control period."""

    fingers: int = 0
    """Number of fingers pressing on the object, with the palm counted as one."""
    opposing: bool = False
    """Whether two of the forces on the object oppose each other."""
    supported: bool = True
    """Whether anything other than the hand touches the object."""
    slip_m_s: float = 0.0
    """Speed of the object relative to the palm [m/s]."""


@dataclass(frozen=True)
class TaskState:
    """State of a task in one control period, used to judge success."""

    time_s: float
    """Time since the start of the episode [s]."""
    world_from_object: np.ndarray
    """T_world_object of the task's object (4, 4)."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Joint of the task's object -> position [rad or m]."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> limits [rad or m]."""
    speeds: Mapping[str, float] = field(default_factory=dict)
    """Joint -> velocity [rad/s or m/s]."""
    grasp: GraspState = GraspState()
    """Grasp state of the object."""
