"""Joint between two parts from their relative motion: a rotation about a line, or a translation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dextera_build.geometry import lie, transforms

from .clouds import Sight
from .matching import BORDERS, Pairs, Target, narrow
from .plausible import axis_of

MEASUREMENTS = 40.0
"""Effective number of independent measurements of all pairs: errors of neighbouring pixels are correlated."""
BORDER_M = 0.001
"""Common error of all borders [m]: depth is missing equally at each. It moves the axis of a small rotation far."""
UPRIGHT = 2.0
"""Standard deviations within which an axis is made vertical or horizontal."""
LEAST_TURN = np.radians(3.0)
"""Rotations below this angle are distinguished from a translation by the residuals [rad]."""


@dataclass(frozen=True)
class Screw:
    """Rotation about a line or translation along a direction, with the uncertainty from the residuals."""

    type: Literal["revolute", "prismatic"]
    origin: np.ndarray  # (3,) on the axis, nearest to the centre of the part [m]
    axis: np.ndarray  # (3,) unit
    amount: float  # positive [rad or m]
    axis_sigma: float  # standard deviation of the direction [rad]
    origin_sigma: float  # standard deviation of the line's position; 0 for a translation [m]
    amount_sigma: float  # [rad or m]
    residual: float  # root mean square distance of the pairs [m]

    def motion(self, amount: float | None = None) -> np.ndarray:
        """The (4, 4) motion by `amount`."""
        amount = self.amount if amount is None else amount
        return lie.turned(self.axis, self.origin, amount) if self.type == "revolute" else slid(self.axis, amount)


def slid(axis: np.ndarray, distance: float) -> np.ndarray:
    """(4, 4) shift by `distance` [m] along unit `axis`."""
    return transforms.rigid(np.eye(3), axis * distance)


def fit(part: Sight, target: Target, start: np.ndarray, up: np.ndarray) -> Screw | None:
    """The rotation or translation that registers `part` to `target`, near the rigid motion `start` (4, 4).

    An axis that is vertical or horizontal within its uncertainty is made exactly so, as most joints are.

    Args:
        part: The moved part.
        target: Its surface after the motion.
        start: (4, 4) first guess.
        up: (3,) direction away from the support.

    Returns:
        The better of the two; None if `start` gives too few pairs.
    """
    turn, slide = _revolute(part, target, start), _prismatic(part, target, start)
    if turn is None or slide is None:
        return turn or slide
    # A translation has two parameters fewer; a small rotation about a distant line resembles one.
    if turn.amount < LEAST_TURN and slide.residual < 1.15 * turn.residual + 1e-4:
        return slide
    upright = _upright(turn, up)
    if upright is None:
        return turn
    again = _revolute(part, target, lie.turned(upright, turn.origin, turn.amount), upright)
    return turn if again is None or again.residual > 1.1 * turn.residual + 1e-4 else again


def _upright(turn: Screw, up: np.ndarray) -> np.ndarray | None:
    """The vertical or horizontal direction within the uncertainty of the axis; None if there is none."""
    sine = float(turn.axis @ up)
    if np.arccos(min(1.0, abs(sine))) < UPRIGHT * turn.axis_sigma:
        return np.asarray(up * np.sign(sine))
    if np.arcsin(abs(sine)) < UPRIGHT * turn.axis_sigma:
        level = turn.axis - up * sine
        return np.asarray(level / np.linalg.norm(level))
    return None


def _revolute(part: Sight, target: Target, start: np.ndarray, fixed: np.ndarray | None = None) -> Screw | None:
    """The rotation near `start`; if a direction `fixed` (3,) is given, only the position of the axis is free."""
    angle = transforms.angle(start[:3, :3])
    if angle < 1e-3:
        return None
    middle = part.inner.points.mean(axis=0)
    axis, origin, _ = axis_of(start, middle)
    one = np.linalg.svd(axis[None])[2][1]
    two = np.cross(axis, one)
    tilt = 0.0 if fixed is not None else 1.0

    def line(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        direction = axis + tilt * (p[0] * one + p[1] * two)
        return direction / np.linalg.norm(direction), origin + p[2] * one + p[3] * two

    def motion(p: np.ndarray) -> np.ndarray:
        return lie.turned(*line(p), p[4])

    solved = _solve(part, target, motion, np.array([0.0, 0.0, 0.0, 0.0, angle]))
    if solved is None:
        return None
    p, covariance, residual = solved
    direction, place = line(p)
    place = place + direction * (direction @ (middle - place))
    deviation = np.sqrt(np.diag(covariance))
    return Screw(
        "revolute",
        place,
        direction if p[4] >= 0 else -direction,
        abs(float(p[4])),
        0.0 if fixed is not None else float(np.hypot(deviation[0], deviation[1])),
        float(np.sqrt(deviation[2] ** 2 + deviation[3] ** 2 + (0.5 * BORDER_M / np.sin(0.5 * abs(p[4]))) ** 2)),
        float(deviation[4]),
        residual,
    )


def _prismatic(part: Sight, target: Target, start: np.ndarray) -> Screw | None:
    middle = part.inner.points.mean(axis=0)
    shift = transforms.apply(start, middle) - middle

    def motion(p: np.ndarray) -> np.ndarray:
        return transforms.rigid(np.eye(3), p)

    solved = _solve(part, target, motion, shift)
    if solved is None:
        return None
    p, covariance, residual = solved
    length = float(np.linalg.norm(p))
    if length < 1e-4:
        return None
    axis = p / length
    along = float(axis @ covariance @ axis)
    across = max(0.0, float(np.trace(covariance)) - along)
    return Screw(
        "prismatic", middle, axis, length, float(np.sqrt(across) / length), 0.0, float(np.sqrt(along)), residual
    )


def _solve(
    part: Sight, target: Target, motion: Callable[[np.ndarray], np.ndarray], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Parameters, their covariance and the residual [m] of the motion that registers `part` to `target`."""
    from scipy.optimize import least_squares

    now = start
    sigma = max(part.sigma, target.sight.sigma)
    for gate in narrow(sigma)[::2]:
        moved = part.moved(motion(now))
        on, at = target.surfaces(moved.inner, gate), target.borders(moved.border, gate)
        if len(on.own) < 12:
            return None
        solved = least_squares(_Rows(part, on, at, motion), now, loss="soft_l1", f_scale=2 * sigma)
        now = solved.x
    distances, slopes = np.asarray(solved.fun), np.asarray(solved.jac)
    scale = max(float(np.mean(distances**2)), (0.5 * sigma) ** 2)
    information = slopes.T @ slopes * (MEASUREMENTS / len(distances)) / scale
    covariance = np.linalg.pinv(information + 1e-9 * np.trace(information) * np.eye(len(now)))
    return now, covariance, float(np.sqrt(np.mean(distances**2)))


class _Rows:
    """Distances of points to their corresponding planes, as a function of the parameters of a motion."""

    def __init__(self, part: Sight, on: Pairs, at: Pairs, motion: Callable[[np.ndarray], np.ndarray]) -> None:
        self.motion = motion
        self.points = np.concatenate([part.inner.points[on.own], part.border.points[at.own]])
        self.partner = np.concatenate([on.partner, at.partner])
        self.normal = np.concatenate([on.normal, at.normal])
        share = min(1.0, BORDERS * len(on.own) / max(1, len(at.own)))
        self.weight = np.concatenate([np.ones(len(on.own)), np.full(len(at.own), np.sqrt(share))])

    def __call__(self, parameters: np.ndarray) -> np.ndarray:
        """(N,) weighted distances [m]."""
        offset = transforms.apply(self.motion(parameters), self.points) - self.partner
        return np.asarray((offset * self.normal).sum(axis=1) * self.weight)
