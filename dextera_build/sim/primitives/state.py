"""The states that determine success, measured the same way in every world.

All arrays have a leading axis of N worlds of one task; a single world is N = 1. So the same code judges one simulator,
several threads and a batch.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np

OPPOSING = -0.3
"""Cosine between two forces on the object below which they oppose each other."""
SLIP_M_S = 0.05
"""Maximum speed of a held object relative to the palm [m/s]; the same in every world."""

T = TypeVar("T")


@dataclass(eq=False)  # not frozen, which would double the time to make one
class GraspState:
    """Grasp states of the task's object in one hand, or in several as one, in one control period."""

    fingers: np.ndarray
    """Number of the hand's fingers pressing on the object (N,), with the palm counted as one."""
    opposing: np.ndarray
    """Whether two of their forces on the object oppose each other (N,)."""
    supported: np.ndarray
    """Whether anything other than a hand, this one or another, touches the object (N,)."""
    slip_m_s: np.ndarray
    """Speed of the object relative to the palm (N,) [m/s]; 0 where no finger presses."""
    pushes: np.ndarray
    """Unit direction of the force of every finger (N, F, 3), in the world; 0 for one that does not press."""

    @classmethod
    def none(cls, supported: np.ndarray, fingers: int = 0) -> Self:
        """No finger presses.

        Args:
            supported: Whether anything other than a hand touches the object (N,).
            fingers: Number F of the hand's fingers.
        """
        count = len(supported)
        zeros = np.zeros(count)
        return cls(np.zeros(count, int), np.zeros(count, bool), supported, zeros, np.zeros((count, fingers, 3)))

    @cached_property
    def presses(self) -> np.ndarray:
        """Whether a finger presses (N,)."""
        return np.asarray(self.fingers > 0)

    @cached_property
    def held(self) -> np.ndarray:
        """Whether at least two fingers press from opposing sides (N,)."""
        return np.asarray((self.fingers >= 2) & self.opposing)

    @cached_property
    def valid(self) -> np.ndarray:
        """Whether the hand holds the object (N,): opposing fingers and no slip. Comparisons fail on NaN."""
        return np.asarray(self.held & (self.slip_m_s < SLIP_M_S))

    @cached_property
    def alone(self) -> np.ndarray:
        """Whether the hand holds the object and nothing but hands touches it (N,)."""
        return np.asarray(self.valid & ~self.supported)


def opposed(pushes: np.ndarray) -> np.ndarray:
    """Whether two of the unit directions (N, F, 3) oppose each other (N,)."""
    cosines = pushes @ pushes.swapaxes(1, 2)
    return np.asarray(cosines.min(axis=(1, 2), initial=1.0) < OPPOSING)


def together(grasps: Iterable[GraspState]) -> GraspState:
    """The grasp states of several hands as one: two flat hands that press from both sides hold a box."""
    parts = list(grasps)
    if len(parts) == 1:
        return parts[0]
    pushes = np.concatenate([part.pushes for part in parts], axis=1)
    return GraspState(
        fingers=np.sum([part.fingers for part in parts], axis=0),
        opposing=np.any([part.opposing for part in parts], axis=0) | opposed(pushes),
        supported=np.any([part.supported for part in parts], axis=0),
        slip_m_s=np.max([part.slip_m_s for part in parts], axis=0),
        pushes=pushes,
    )


@dataclass(eq=False)
class TaskState:
    """States of a task in one control period, used to judge success."""

    time_s: np.ndarray
    """Time since the start of the episode (N,) [s]."""
    world_from_object: np.ndarray
    """T_world_object of the task's object (N, 4, 4)."""
    others: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Other body that the goal names -> T_world_body (N, 4, 4)."""
    joints: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Joint of the task's object -> position (N,) [rad or m]."""
    ranges: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Joint -> limits (N, 2) [rad or m]."""
    speeds: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Joint -> velocity (N,) [rad/s or m/s]."""
    grasps: Mapping[str, GraspState] = field(default_factory=dict)
    """Limb -> grasp state of the object in its hand."""
    derived: dict[Any, tuple[Any, Any]] = field(default_factory=dict, init=False, repr=False)
    """Quantities computed from these states once, see `once`."""

    def once(self, name: Any, of: object, measure: Callable[[TaskState], T]) -> T:
        """A quantity of these states that is needed several times.

        Args:
            name: Its name.
            of: What else it depends on, such as a goal; compared by identity.
            measure: Computes it.
        """
        found = self.derived.get(name)
        if found is None or found[0] is not of:
            found = self.derived[name] = of, measure(self)
        value: T = found[1]
        return value

    @property
    def place(self) -> np.ndarray:
        """Position of the object's origin in the world (N, 3) [m]."""
        return self.world_from_object[:, :3, 3]

    @property
    def supported(self) -> np.ndarray:
        """Whether anything other than a hand touches the object (N,)."""
        if not self.grasps:
            return np.ones(len(self.time_s), bool)
        return functools.reduce(np.logical_or, [grasp.supported for grasp in self.grasps.values()])

    def touched(self, but: Sequence[str] = ()) -> np.ndarray:
        """Whether a hand presses on the object (N,).

        Args:
            but: Limbs whose hands do not count.
        """
        known = [grasp.presses for name, grasp in self.grasps.items() if name not in but]
        return functools.reduce(np.logical_or, known) if known else np.zeros(len(self.time_s), bool)

    def hand(self, limb: str) -> GraspState:
        """Grasp state of the object in the hand of one limb."""
        return self.grasps[limb] if limb in self.grasps else GraspState.none(np.ones(len(self.time_s), bool))

    def grasp(self, limbs: Sequence[str] = ()) -> GraspState:
        """The combined grasp state of the hands that press on the object.

        Args:
            limbs: Hands that must hold it, all of them and no other; empty: any.

        Returns:
            Nothing held, if a named hand does not press or another one does.
        """
        if not set(limbs) <= self.grasps.keys() or not self.grasps:
            return GraspState.none(self.supported)
        if len(self.grasps) == 1:
            return next(iter(self.grasps.values()))
        return self.once(tuple(limbs), None, lambda _: self._grasp(limbs))

    def _grasp(self, limbs: Sequence[str]) -> GraspState:
        found = together(self.grasps.values())
        pressing = [grasp.presses == (name in limbs) for name, grasp in self.grasps.items()]
        right = functools.reduce(np.logical_and, pressing) if limbs else found.presses
        return GraspState(
            fingers=found.fingers * right,
            opposing=found.opposing & right,
            supported=self.supported,
            slip_m_s=np.where(right, found.slip_m_s, 0.0),
            pushes=found.pushes * right[:, None, None],
        )


def stacked(states: Sequence[TaskState]) -> TaskState:
    """The states of several worlds of one task as one, in order."""
    found: TaskState = _stacked(states)
    return found


def chosen(worlds: np.ndarray, one: TaskState, other: TaskState) -> TaskState:
    """The states `one` of the worlds where `worlds` (N,) is True, and `other` of the rest."""
    found: TaskState = _chosen(worlds, one, other)
    return found


def _chosen(worlds: np.ndarray, one: Any, other: Any) -> Any:
    if isinstance(one, np.ndarray):
        return np.where(worlds.reshape(-1, *[1] * (one.ndim - 1)), one, other)
    if isinstance(one, Mapping):
        return {name: _chosen(worlds, one[name], other[name]) for name in one}
    names = [each.name for each in fields(one) if each.init]
    return type(one)(*(_chosen(worlds, getattr(one, name), getattr(other, name)) for name in names))


def _stacked(parts: Sequence[Any]) -> Any:
    first = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)
    if isinstance(first, Mapping):
        return {name: _stacked([part[name] for part in parts]) for name in first}
    names = [each.name for each in fields(first) if each.init]
    return type(first)(*(_stacked([getattr(part, name) for part in parts]) for name in names))
