"""Observations of policies: measurements with a leading axis of worlds, and the functions of dxb's own terms.

Every function takes the measurements of N worlds and returns an array (N, ...); a single world is N = 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dextera_build.policy.declared import DECLARED


@dataclass(frozen=True)
class Embodied:
    """Constants of a task's robot and objects, in addition to the measurements."""

    target: int
    """Row of the task's object among the objects."""
    palms: Callable[[np.ndarray], np.ndarray]
    """Joint positions (N, A) to the poses of the palms in the base (N, L, 7), by forward kinematics."""
    world_from_base: np.ndarray
    """T_world_base (4, 4) of the task, as calibrated; the table's plane is z = 0 of the world."""


@dataclass(eq=False)  # not frozen, which would double the time to make one
class Seen:
    """Measurements of N worlds of one task, all in the robot's base frame.

    Poses are position [m] and unit quaternion w x y z with w >= 0. Nothing here comes from a simulator's state, so a
    term that is computed from it also exists on hardware, with the noise and delay of the measurements.
    """

    joints: np.ndarray
    """Positions of the robot's joints (N, A) [rad]."""
    objects: np.ndarray
    """Tracked poses of the objects (N, O, 7)."""
    displacement: np.ndarray
    """Positions of the objects' joints (N, K) [rad or m]."""
    previous_action: np.ndarray
    """Joint targets that were sent last (N, A) [rad]."""
    goal: np.ndarray
    """Goals (N, G)."""
    embodied: Embodied | None = None
    """The task's robot and objects, for terms that are added."""

    @cached_property
    def target(self) -> np.ndarray:
        """Tracked poses of the task's object (N, 7)."""
        assert self.embodied is not None
        return self.objects[:, self.embodied.target]

    @cached_property
    def palms(self) -> np.ndarray:
        """Poses of the palms (N, L, 7), computed from the measured joints; the identity for a missing palm."""
        assert self.embodied is not None
        return self.embodied.palms(self.joints)

    @property
    def world_from_base(self) -> np.ndarray:
        """T_world_base (4, 4), one for all worlds: as calibrated, not the true base of an episode."""
        assert self.embodied is not None
        return self.embodied.world_from_base


def previous_action(worlds: Seen) -> np.ndarray:
    """Joint targets that were sent last (N, A)."""
    return worlds.previous_action


def joints(worlds: Seen) -> np.ndarray:
    """Positions of the robot's joints (N, A)."""
    return worlds.joints


def objects(worlds: Seen) -> np.ndarray:
    """Poses of the objects (N, O, 7)."""
    return worlds.objects


def displacement(worlds: Seen) -> np.ndarray:
    """Positions of the objects' joints (N, K)."""
    return worlds.displacement


def goal(worlds: Seen) -> np.ndarray:
    """Goals (N, G)."""
    return worlds.goal.copy()


MEASURES: Mapping[str, Callable[[Seen], np.ndarray]] = {
    term.name: globals()[term.name] for term in DECLARED if term.is_vector
}
"""Deployable term -> its function, which has its name."""


def values(worlds: Seen) -> dict[str, np.ndarray]:
    """Deployable term of dxb -> its values (N, ...) float32."""
    return {name: np.asarray(measure(worlds), np.float32) for name, measure in MEASURES.items()}
