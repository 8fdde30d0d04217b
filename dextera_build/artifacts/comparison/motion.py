"""Motion of a pose between two stored values, with the interval that follows from their covariances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.spatial.pose import Pose, Similarity
from dextera_build.geometry import transforms

KINDS: Mapping[str, type[Pose] | type[Similarity]] = {"Pose": Pose, "Similarity": Similarity}
"""Name of an artifact type that is a pose -> the type."""
TWO_SIDED = 1.96
"""Two-sided 95 % quantile of the normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Motion:
    """Motion between two values of T_parent_child."""

    frames: str
    """`T_parent_child`."""
    distance_m: float
    """Distance between the origins of the child frame [m]."""
    angle_deg: float
    """Angle between its orientations [deg]."""
    distance_interval_m: tuple[float, float] | None
    """95 % interval, assuming independent values [m]; None if neither states its covariance."""
    angle_interval_deg: tuple[float, float] | None
    """The same for the angle [deg]."""

    def __str__(self) -> str:
        """The motion in one line."""
        far = _told(1000 * self.distance_m, self.distance_interval_m, 1000.0, "mm")
        return f"{self.frames} moved by {far} and {_told(self.angle_deg, self.angle_interval_deg, 1.0, 'deg')}"

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def between(old: Artifact, new: Artifact) -> Motion | None:
    """The motion between two poses of the same frames; None for anything else."""
    if not (isinstance(old, Pose | Similarity) and isinstance(new, type(old))):
        return None
    if (old.parent, old.child) != (new.parent, new.child):
        return None
    shift = new.matrix[:3, 3] - old.matrix[:3, 3]
    turn = new.matrix[:3, :3] @ old.matrix[:3, :3].T
    distance, angle = float(np.linalg.norm(shift)), float(np.degrees(transforms.angle(turn)))
    spread = _spread(old, new)
    far = None if spread is None else _interval(distance, _along(shift, spread[:3, :3]))
    turned = None if spread is None else _interval(angle, np.degrees(_along(_axis(turn), spread[3:6, 3:6])))
    return Motion(f"T_{old.parent}_{old.child}", distance, angle, far, turned)


def _spread(old: Pose | Similarity, new: Pose | Similarity) -> np.ndarray | None:
    known = [each.covariance for each in (old, new) if each.covariance is not None]
    return sum(known[1:], known[0]) if known else None


def _along(direction: np.ndarray, covariance: np.ndarray) -> float:
    """Standard deviation along a direction (3,); the largest of all directions if it has no length."""
    length = float(np.linalg.norm(direction))
    if length < 1e-12:
        return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    unit = direction / length
    return float(np.sqrt(max(0.0, unit @ covariance @ unit)))


def _axis(turn: np.ndarray) -> np.ndarray:
    """A vector (3,) along the axis of a rotation; it vanishes for half a turn, as its sine does."""
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def _interval(value: float, sigma: float) -> tuple[float, float]:
    return max(0.0, value - TWO_SIDED * sigma), value + TWO_SIDED * sigma


def _told(value: float, interval: tuple[float, float] | None, scale: float, unit: str) -> str:
    if interval is None:
        return f"{value:.3g} {unit}"
    low, high = (f"{scale * edge:.3g}" for edge in interval)
    return f"{value:.3g} {unit} [{low}, {high}]"
