"""The state that determines success, measured the same way in every world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

OPPOSING = -0.3
"""Cosine between two forces on the object below which they oppose each other."""
SLIP_M_S = 0.05
"""Maximum speed of a held object relative to the palm [m/s]; the same in every world."""


@dataclass(frozen=True)
class GraspState:
    """Grasp state of the task's object in one hand, in one control period."""

    fingers: int = 0
    """Number of the hand's fingers pressing on the object, with the palm counted as one."""
    opposing: bool = False
    """Whether two of their forces on the object oppose each other."""
    supported: bool = True
    """Whether anything other than a hand, this one or another, touches the object."""
    slip_m_s: float = 0.0
    """Speed of the object relative to the palm [m/s]; 0 where no finger presses."""
    pushes: tuple[tuple[float, float, float], ...] = ()
    """Unit direction of the force of every finger that presses, in the world."""

    @property
    def valid(self) -> bool:
        """Whether the hand holds the object: opposing fingers and no slip. Comparisons fail on NaN."""
        return self.fingers >= 2 and self.opposing and self.slip_m_s < SLIP_M_S

    @property
    def alone(self) -> bool:
        """Whether the hand holds the object and nothing but hands touches it."""
        return self.valid and not self.supported


def opposed(pushes: Iterable[Iterable[float]]) -> bool:
    """Whether two of the unit directions oppose each other."""
    unit = np.array(list(pushes), np.float64).reshape(-1, 3)
    return bool(len(unit) >= 2 and (unit @ unit.T).min() < OPPOSING)


def together(grasps: Iterable[GraspState]) -> GraspState:
    """The grasp state of several hands as one: two flat hands that press from both sides hold a box."""
    parts = list(grasps)
    if len(parts) == 1:
        return parts[0]
    pushes = tuple(push for part in parts for push in part.pushes)
    return GraspState(
        fingers=sum(part.fingers for part in parts),
        opposing=any(part.opposing for part in parts) or opposed(pushes),
        supported=any(part.supported for part in parts) if parts else True,
        slip_m_s=float(max((part.slip_m_s for part in parts), default=0.0)),
        pushes=pushes,
    )


@dataclass(frozen=True)
class TaskState:
    """State of a task in one control period, used to judge success."""

    time_s: float
    """Time since the start of the episode [s]."""
    world_from_object: np.ndarray
    """T_world_object of the task's object (4, 4)."""
    others: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Other body that the goal names -> T_world_body (4, 4)."""
    joints: Mapping[str, float] = field(default_factory=dict)
    """Joint of the task's object -> position [rad or m]."""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Joint -> limits [rad or m]."""
    speeds: Mapping[str, float] = field(default_factory=dict)
    """Joint -> velocity [rad/s or m/s]."""
    grasps: Mapping[str, GraspState] = field(default_factory=dict)
    """Limb -> grasp state of the object in its hand."""

    @property
    def touching(self) -> tuple[str, ...]:
        """Limbs whose hands press on the object."""
        return tuple(name for name, grasp in self.grasps.items() if grasp.fingers > 0)

    @property
    def supported(self) -> bool:
        """Whether anything other than a hand touches the object."""
        return any(grasp.supported for grasp in self.grasps.values()) or not self.grasps

    def grasp(self, limbs: Iterable[str] = ()) -> GraspState:
        """The combined grasp state of the hands that press on the object.

        Args:
            limbs: Hands that must hold it, all of them and no other; empty: any.

        Returns:
            Nothing held, if a named hand does not press or another one does.
        """
        named, touching = tuple(limbs), self.touching
        if named and set(named) != set(touching):
            return GraspState(supported=self.supported)
        if not touching:
            return GraspState(supported=self.supported)
        return together(self.grasps[name] for name in touching)
