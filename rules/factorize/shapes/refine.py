"""Fit a body's parameters to a view by damped least squares on rendered depth and silhouette residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from dextera_build.geometry import least_squares, raycast
from dextera_build.geometry.least_squares import Local, Schedule
from dextera_build.geometry.solids import Solid

from .evidence import REACH_PX, STEP_PX, Evidence

DEPTH_CAP = 8.0
"""Maximum depth residual, in standard deviations; also the residual of a ray that misses the body."""
SOFT = 2.5
"""Scale above which residuals are downweighted, in standard deviations (Cauchy)."""
INDEPENDENT = 40.0
"""Effective number of independent residuals; errors of neighbours are correlated."""
SIGMA_PX = 1.0
"""Standard deviation of the silhouette [px]."""


@dataclass(frozen=True)
class Model:
    """A family of bodies with parameters, in the world frame of the support."""

    name: str
    build: Callable[[np.ndarray], Solid]
    """Parameters -> closed surface in the world frame."""
    starts: list[np.ndarray]
    """Initial guesses."""
    steps: np.ndarray
    """Finite-difference step per parameter, about the precision that matters [m or rad]."""
    lower: np.ndarray
    upper: np.ndarray
    expected: np.ndarray | None = None
    """Prior mean of each parameter."""
    spread: np.ndarray = field(default_factory=lambda: np.array(np.inf))
    """Standard deviation about `expected`; infinite without a prior."""
    smooth: np.ndarray | None = None
    """Linear combinations (R, P) of parameters expected near 0, in standard deviations: profiles bend slowly."""
    cost: float = 0.0
    """Complexity, subtracted from the score."""


@dataclass(frozen=True)
class Fit:
    """Result of a fit."""

    parameters: np.ndarray
    loss: float


def fit(model: Model, evidence: Evidence, iterations: int, tries: int = 2) -> Fit:
    """Fit `model`: judge every start and refine the best `tries`."""
    starts = [np.clip(start, model.lower, model.upper) for start in model.starts]
    losses = [_loss(model, evidence, start)[0] for start in starts]
    order = np.argsort(losses, kind="stable")[:tries]
    short = max(3, iterations // 3)
    first = [descend(model, evidence, starts[i], short) for i in order]
    best = min(first, key=lambda found: found.loss)
    return descend(model, evidence, best.parameters, iterations - short)


def descend(model: Model, evidence: Evidence, start: np.ndarray, iterations: int) -> Fit:
    """Levenberg-Marquardt with finite differences from one start."""
    objective = _Objective(model, evidence)
    begin = start.copy()
    schedule = Schedule(4 * iterations, taken=iterations, in_turn=4, gain=1e-4, least=1e-5)
    found, (loss, _, _) = least_squares.levenberg_marquardt(begin, objective.at(begin), objective, schedule)
    return Fit(found, loss)


Seen = tuple[float, np.ndarray, np.ndarray]
"""Loss, residuals and their weights at some parameters."""


@dataclass(frozen=True)
class _Objective:
    """The loss, for steps in units of `Model.steps`."""

    model: Model
    evidence: Evidence

    def at(self, parameters: np.ndarray) -> Seen:
        return _loss(self.model, self.evidence, parameters)

    def value(self, seen: Seen, before: Seen) -> float:
        return seen[0]

    def local(self, parameters: np.ndarray, seen: Seen) -> Local:
        _, residual, weight = seen
        found = least_squares.normal(_slopes(self.model, self.evidence, parameters, residual), -residual, weight)
        bends = np.diag(found.matrix)
        return Local(found, bends + 1e-6 * bends.max(initial=1e-12), floor=1e-12)

    def moved(self, parameters: np.ndarray, step: np.ndarray) -> np.ndarray:
        move, most = step * self.model.steps, 12 * self.model.steps
        return np.asarray(np.clip(parameters + np.clip(move, -most, most), self.model.lower, self.model.upper))


def curvature(model: Model, evidence: Evidence, found: np.ndarray) -> tuple[np.ndarray, float]:
    """Half the second derivative (P, P) of the loss per squared step of the parameters, and the loss at `found`."""
    loss, residual, weight = _loss(model, evidence, found)
    slope = _slopes(model, evidence, found, residual)
    return least_squares.normal(slope, residual, weight).matrix, loss


def undetermined(model: Model, evidence: Evidence, found: np.ndarray, sizes: tuple[int, ...]) -> list[int]:
    """Parameters of `sizes` that could be much larger or smaller, with the others refitted, at no worse fit."""
    loss = _loss(model, evidence, found)[0]
    loose = []
    for index in sizes:
        for factor in (0.75, 1.3):
            start = found.copy()
            start[index] *= factor
            held = np.arange(len(start)) == index
            lower, upper = np.where(held, start, model.lower), np.where(held, start, model.upper)
            other = descend(replace(model, lower=lower, upper=upper), evidence, start, 4)
            if other.loss - loss < 1.0 / INDEPENDENT:
                loose.append(index)
                break
    return loose


def _slopes(model: Model, evidence: Evidence, here: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Change (R, P) of the residuals per step of each parameter, taken in a feasible direction."""
    slope = np.zeros((len(residual), len(here)))
    for i, step in enumerate(model.steps):
        sign = 1.0 if here[i] + step <= model.upper[i] else -1.0
        there = here.copy()
        there[i] += sign * step
        slope[:, i] = sign * (residuals(model, evidence, there) - residual)
    return slope


def _loss(model: Model, evidence: Evidence, parameters: np.ndarray) -> Seen:
    residual = residuals(model, evidence, parameters)
    rows = 0 if model.smooth is None else len(model.smooth)
    seen = len(evidence.rays) + len(evidence.silhouette.rays) + rows
    soft = np.where(np.arange(len(residual)) < seen, SOFT, np.inf)
    share = _shares(evidence, rows, len(parameters))
    squared = np.square(residual)
    rho = np.where(np.isinf(soft), squared, SOFT**2 * np.log1p(squared / SOFT**2))
    return float((share * rho).sum()), residual, share / (1.0 + squared / soft**2)


def _shares(evidence: Evidence, rows: int, parameters: int) -> np.ndarray:
    """Weight of every residual; depth and silhouette have equal total weight regardless of their number."""
    rays, places = len(evidence.rays), len(evidence.silhouette.rays)
    counts, shares = [rays, places, rows, parameters], [1 / max(rays, 1), 1 / max(places, 1), 0.02, 0.02]
    return np.repeat(np.array(shares), counts)


def residuals(model: Model, evidence: Evidence, parameters: np.ndarray) -> np.ndarray:
    """Depth, silhouette and prior residuals in standard deviations: (rays + places + smooth rows + parameters,)."""
    body = model.build(parameters)
    outline = evidence.silhouette
    scene = raycast.RayScene((body.vertices, body.faces))
    far = scene.cast(evidence.fitted_rays).distance.astype(np.float64)
    difference = (far - evidence.ray_depth) / evidence.ray_sigma
    covered = (outline.met(scene) | outline.inside) & ~outline.outside
    excess = (covered.sum(axis=1) * STEP_PX - REACH_PX - STEP_PX / 2) / SIGMA_PX
    prior = np.zeros(len(parameters))
    if model.expected is not None:
        prior = (parameters - model.expected) / np.broadcast_to(model.spread, parameters.shape)
    bends = np.zeros(0) if model.smooth is None else model.smooth @ parameters
    return np.concatenate([np.clip(difference, -DEPTH_CAP, DEPTH_CAP), excess, bends, prior])
