"""Nonlinear least squares: Gauss-Newton and Levenberg-Marquardt searches of vectors and of poses.

A search depends on neither pairs nor poses. Its caller linearises at an estimate and retracts the estimate along a step
(poses by `geometry.lie`); robust losses are reweighted at every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

X = TypeVar("X")
Round = TypeVar("Round")
Seen = TypeVar("Seen")


@dataclass(frozen=True)
class Normal:
    """Normal equations: `matrix` @ step = `right`."""

    matrix: np.ndarray  # (K, K) information
    right: np.ndarray  # (K,)

    def __add__(self, other: Normal) -> Normal:
        """Those of the rows of both."""
        return Normal(self.matrix + other.matrix, self.right + other.right)

    def within(self, basis: np.ndarray) -> Normal:
        """Those of steps in the columns of `basis` (K, J)."""
        return Normal(basis.T @ self.matrix @ basis, basis.T @ self.right)

    def solved(self) -> np.ndarray:
        """The step (K,)."""
        return np.asarray(np.linalg.solve(self.matrix, self.right))

    def shortest(self, least: float) -> np.ndarray:
        """The shortest step (K,), with singular values below the fraction `least` of the largest replaced by zero."""
        return np.asarray(np.linalg.lstsq(self.matrix, self.right, rcond=least)[0])


def normal(rows: np.ndarray, off: np.ndarray, weight: np.ndarray) -> Normal:
    """Normal equations of residuals.

    Args:
        rows: (N, K) derivatives of N quantities by the step.
        off: (N,) desired change of these quantities.
        weight: (N,) inverse of the variances, times robust weights.
    """
    return Normal((rows * weight[:, None]).T @ rows, rows.T @ (weight * off))


def prior(sigma: np.ndarray, off: np.ndarray | float = 0.0) -> Normal:
    """Normal equations of a step expected to be `off` (K,), with standard deviations `sigma` (K,)."""
    return Normal(np.diag(sigma**-2.0), off / sigma**2.0)


def huber(distance: np.ndarray, reach: float | np.ndarray) -> np.ndarray:
    """Weights of distances >= 0 whose influence is constant above `reach`."""
    return np.asarray(np.minimum(1.0, reach / np.maximum(distance, 1e-12)))


def tukey(off: np.ndarray, reach: float | np.ndarray) -> np.ndarray:
    """Weights of residuals without influence above `reach` (biweight)."""
    return np.asarray(np.square(1.0 - np.minimum(np.square(off / reach), 1.0)))


def gauss_newton(
    start: X, step: Callable[[X, Round], tuple[np.ndarray, X] | None], rounds: Iterable[Round], still: float = 0.0
) -> Iterator[X]:
    """The estimates of a search, the start first.

    Args:
        start: First estimate.
        step: Gives the step (K,) from an estimate, and the estimate after it; None ends the search.
        rounds: One entry for each step, passed to `step`: a gate, or just a number.
        still: Largest component of a step below which the search ends.
    """
    now = start
    yield now
    for each in rounds:
        found = step(now, each)
        if found is None:
            return
        change, now = found
        yield now
        if np.abs(change).max() < still:
            return


@dataclass(frozen=True)
class Local:
    """An objective near an estimate: half the sum of squares of linearised residuals."""

    normal: Normal
    scale: np.ndarray  # (K,) damping of each component of a step, usually the diagonal of the matrix
    floor: float = 0.0  # damping that is always added

    def step(self, damping: float) -> np.ndarray:
        """The damped step (K,)."""
        matrix = self.normal.matrix + damping * np.diag(self.scale) + self.floor * np.eye(len(self.scale))
        return Normal(matrix, self.normal.right).solved()

    def gain(self, step: np.ndarray) -> float:
        """Decrease that a step promises."""
        return float(self.normal.right @ step - step @ self.normal.matrix @ step / 2)


class Objective(Protocol[X, Seen]):
    """An objective of `levenberg_marquardt`."""

    def at(self, estimate: X) -> Seen:
        """Residuals or terms at an estimate."""
        ...

    def value(self, seen: Seen, before: Seen) -> float:
        """The objective from its terms; `before` are those that weights are taken from."""
        ...

    def local(self, estimate: X, seen: Seen) -> Local:
        """Its linearisation."""
        ...

    def moved(self, estimate: X, step: np.ndarray) -> X:
        """The estimate after a step."""
        ...


@dataclass(frozen=True)
class Schedule:
    """Damping of `levenberg_marquardt`, and when it ends."""

    tries: int  # maximum number of steps tried
    taken: int | None = None  # maximum number of steps taken
    in_turn: int | None = None  # number of consecutive rejected steps that ends the search
    gain: float = 0.0  # decrease, relative to the objective, below which the search ends
    promise: float = -np.inf  # the same of the expected decrease
    still: float = 0.0  # largest component of a step below which the search ends
    damping: float = 1e-2  # at the start
    easier: float = 4.0  # it is divided by this after a step that is taken
    harder: float = 6.0  # it is multiplied by this after one that is rejected
    least: float = 1e-6
    most: float = np.inf  # a step rejected with more damping ends the search


def levenberg_marquardt(start: X, seen: Seen, objective: Objective[X, Seen], schedule: Schedule) -> tuple[X, Seen]:
    """The last estimate and its terms; a step is taken only if the objective itself decreases.

    Args:
        start: First estimate.
        seen: Its terms, `objective.at(start)`.
        objective: See `Objective`.
        schedule: See `Schedule`.
    """
    now, damping, taken, rejected = start, schedule.damping, 0, 0
    local: Local | None = None
    for _ in range(schedule.tries):
        local = local or objective.local(now, seen)
        value, step = objective.value(seen, seen), local.step(damping)
        if np.abs(step).max() < schedule.still or local.gain(step) < schedule.promise * value:
            break
        there = objective.moved(now, step)
        found = objective.at(there)
        gained = value - objective.value(found, seen)
        if gained > 0:
            now, seen, local, taken, rejected = there, found, None, taken + 1, 0
            damping = max(damping / schedule.easier, schedule.least)
            if gained < schedule.gain * value or taken == schedule.taken:
                break
        else:
            rejected += 1
            if rejected == schedule.in_turn or damping > schedule.most:
                break
            damping *= schedule.harder
    return now, seen
