"""Deployable and privileged observations, as two types to prevent confusion.

Table I of the paper; both hold values by term, and `declared` describes every term. Deployable values are also
available from sensors and an object tracker on hardware; privileged ones are read from the simulator's state, for
teachers and critics only. Poses and forces are expressed in the robot's base frame, which is available on hardware
without a world frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dextera_build.policy.declared import HIDDEN
from dextera_build.policy.seen import Seen, values

if TYPE_CHECKING:
    from dextera_build.policy.added import AddedTerms


@dataclass(frozen=True)
class Frame:
    """One camera's frame."""

    rgb: np.ndarray | None = None
    """Picture (H, W, 3) uint8 sRGB, or None."""
    depth: np.ndarray | None = None
    """Image-plane distance (H, W) float32 [m], 0 where nothing was measured, or None."""
    cloud: np.ndarray | None = None
    """Points (H, W, 3) float32 [m] in the camera's frame, back-projected from `depth`, or None."""


Frames = Mapping[str, Frame]
"""Camera -> its frame."""


@dataclass(frozen=True)
class Measurement:
    """The measurements of a robot cell in one control period; simulated and real cells fill in the same fields."""

    joints: np.ndarray
    """Positions of the robot's joints (A,) [rad]."""
    objects: np.ndarray
    """Tracked poses of the objects (O, 7): position [m], unit quaternion w x y z with w >= 0, in the base frame."""
    displacement: np.ndarray
    """Positions of the objects' joints (K,) [rad or m]."""
    frames: Frames = field(default_factory=dict)
    """Frames of all cameras."""

    @property
    def placed(self) -> bool:
        """Whether all objects and their joints were measured."""
        return bool(np.isfinite(self.objects).all() and np.isfinite(self.displacement).all())


@dataclass(frozen=True)
class DeployableObservation:
    """All inputs that a policy may use, made from a `Measurement`, never from a simulator's state."""

    values: Mapping[str, np.ndarray]
    """Term -> its values, float32; see `declared`."""
    frames: Frames = field(default_factory=dict)
    """Frames of all cameras; a `Frame` has the terms `rgb`, `depth` and `cloud`."""

    def __post_init__(self) -> None:
        if not HIDDEN.isdisjoint(self.values):
            raise TypeError(f"policies may not see {sorted(HIDDEN & self.values.keys())}")

    def __getitem__(self, term: str) -> np.ndarray:
        """Values of a term."""
        return self.values[term]

    @property
    def rgb(self) -> np.ndarray | None:
        """Picture (H, W, 3) uint8 sRGB of the first camera, or None."""
        return next((frame.rgb for frame in self.frames.values()), None)


@dataclass(frozen=True)
class PrivilegedObservation:
    """Values available only in a simulator."""

    values: Mapping[str, np.ndarray]
    """Term -> its values, float32; see `declared`."""

    def __getitem__(self, term: str) -> np.ndarray:
        """Values of a term."""
        return self.values[term]


def deployable(
    measured: Measurement, previous_action: np.ndarray, goal: np.ndarray, added: AddedTerms | None = None
) -> DeployableObservation:
    """The observation of a policy from one measurement; the only way to make one at run time.

    Args:
        measured: The measurement.
        previous_action: Joint targets that were sent last (A,) [rad].
        goal: Goal (G,).
        added: Terms that do not come with dxb.
    """
    worlds = Seen(
        measured.joints[None],
        measured.objects[None],
        measured.displacement[None],
        previous_action[None],
        goal[None],
        None if added is None else added.embodied,
    )
    found = _values(worlds, added)
    return DeployableObservation({name: value[0] for name, value in found.items()}, measured.frames)


def in_worlds(
    measured: Sequence[Measurement],
    previous_actions: Sequence[np.ndarray],
    goals: Sequence[np.ndarray],
    added: AddedTerms | None = None,
) -> dict[str, np.ndarray]:
    """Deployable term -> its values in N worlds (N, ...) float32, without pictures."""
    worlds = Seen(
        np.stack([each.joints for each in measured]),
        np.stack([each.objects for each in measured]),
        np.stack([each.displacement for each in measured]),
        np.stack(previous_actions),
        np.stack(goals),
        None if added is None else added.embodied,
    )
    return _values(worlds, added)


def _values(worlds: Seen, added: AddedTerms | None) -> dict[str, np.ndarray]:
    own = values(worlds)
    return own if added is None else own | added.values(worlds)
