"""Estimation of dynamics: nonlinear least squares on joints of arms, with what the twin states as a prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import least_squares
from dextera_build.geometry.least_squares import Normal

from .arm import Arm, Run, Values

STEP = 1e-3
"""Step of the finite differences, in the units of each quantity."""
LEAST = 1e-4
"""Least standard deviation of a residual [rad or m]."""
LIMITS = {"log_stiffness": 1.0, "log_lag": 1.5, "log_mass": 3.0}
"""Largest absolute values."""


@dataclass(frozen=True)
class Layout:
    """Places of the quantities in a vector (K,): three for each of J joints, then those of all."""

    joints: int

    BLOCKS = ("log_stiffness", "log_lag", "friction")
    COMMON = ("latency_s", "log_mass", "x", "y", "z", "mu", "lifted")

    @property
    def size(self) -> int:
        """Length of the vector."""
        return 3 * self.joints + len(self.COMMON)

    def block(self, number: int) -> slice:
        """A quantity of all joints."""
        return slice(number * self.joints, (number + 1) * self.joints)

    def common(self, name: str) -> int:
        """A quantity of the whole."""
        return 3 * self.joints + self.COMMON.index(name)

    def vector(self, values: Values) -> np.ndarray:
        """The vector (K,) of values."""
        joints = [getattr(values, name) for name in self.BLOCKS]
        common = [values.latency_s, values.log_mass, *values.centre, values.mu, values.lifted]
        return np.concatenate([*joints, common])

    def values(self, vector: np.ndarray) -> Values:
        """The values of a vector (K,), within their limits."""
        blocks = {name: vector[self.block(number)] for number, name in enumerate(self.BLOCKS)}
        latency, mass, x, y, z, mu, lifted = vector[3 * self.joints :]
        return Values(
            log_stiffness=np.clip(blocks["log_stiffness"], -LIMITS["log_stiffness"], LIMITS["log_stiffness"]),
            log_lag=np.clip(blocks["log_lag"], -LIMITS["log_lag"], LIMITS["log_lag"]),
            friction=np.maximum(blocks["friction"], 0.0),
            latency_s=float(np.clip(latency, 0.0, 0.3)),
            log_mass=float(np.clip(mass, -LIMITS["log_mass"], LIMITS["log_mass"])),
            centre=np.array([x, y, z]),
            mu=float(np.clip(mu, 0.02, 3.0)),
            lifted=float(np.clip(lifted, -0.9, 0.9)),
        )


@dataclass(frozen=True)
class Prior:
    """What is known without recordings: mean and standard deviation of every quantity (K,)."""

    mean: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class Fit:
    """The result."""

    values: np.ndarray
    """(K,)."""
    covariance: np.ndarray
    """(K, K)."""
    residual: float
    """Root mean square of the residuals [rad or m]."""


def rows_of(run: Run) -> np.ndarray:
    """Rows (T,) of a recording that are compared."""
    phases = run.phases
    used = phases.free.copy()
    for part in (phases.carried, phases.pushed):
        if part is not None:
            used |= part
    used[0] = False
    return used


def fit(arm: Arm, runs: Sequence[Run], prior: Prior, rounds: int) -> Fit:
    """Estimate all quantities from recordings.

    Each residual has the variance of its joint's residuals times their integrated autocorrelation time, so that
    neighbouring rows, which err alike, do not count as independent.

    Args:
        arm: Simulates the robot.
        runs: The recordings, each with rows that are compared.
        prior: See `Prior`.
        rounds: Gauss-Newton steps.
    """
    layout = Layout(len(arm.joints))
    masks = [rows_of(run) for run in runs]

    def off(values: Values) -> list[np.ndarray]:
        return [run.joints - arm.simulate(run, values) for run in runs]

    def normal(vector: np.ndarray) -> tuple[Normal, float]:
        values = layout.values(vector)
        missing = off(values)
        variance = _variance(missing, masks)
        total = least_squares.prior(prior.sigma, prior.mean - vector)
        for run, mask, each in zip(runs, masks, missing, strict=True):
            rows = _derivatives(arm, layout, run, values, run.joints - each)[mask]
            weight = np.broadcast_to(1.0 / variance, each[mask].shape).ravel()
            total = total + least_squares.normal(rows.reshape(-1, layout.size), each[mask].ravel(), weight)
        kept = np.concatenate([each[mask].ravel() for each, mask in zip(missing, masks, strict=True)])
        return total, float(np.sqrt(np.mean(kept**2)))

    def step(vector: np.ndarray, _: int) -> tuple[np.ndarray, np.ndarray]:
        change = normal(vector)[0].solved()
        # A quantity at its limit stays there.
        return change, layout.vector(layout.values(vector + change))

    *_, found = least_squares.gauss_newton(prior.mean, step, range(rounds), 1e-4)
    last, residual = normal(found)
    return Fit(found, np.linalg.inv(last.matrix), residual)


def _derivatives(arm: Arm, layout: Layout, run: Run, values: Values, base: np.ndarray) -> np.ndarray:
    """Derivatives (T, J, K) of the simulated joints (T, J).

    A controller is changed for all joints at once, and the change of each joint is attributed to its own controller:
    through inertia the others matter little.
    """
    count = layout.joints
    rows = np.zeros((*base.shape, layout.size))
    vector, each = layout.vector(values), np.arange(count)
    for number in range(len(layout.BLOCKS)):
        moved = vector.copy()
        moved[layout.block(number)] += STEP
        change = (arm.simulate(run, layout.values(moved)) - base) / STEP
        rows[:, each, number * count + each] = change
    for name in _concerned(run):
        moved = vector.copy()
        moved[layout.common(name)] += STEP
        rows[:, :, layout.common(name)] = (arm.simulate(run, layout.values(moved)) - base) / STEP
    return rows


def _concerned(run: Run) -> tuple[str, ...]:
    if run.phases.carried is not None:
        return ("latency_s", "log_mass", "x", "y", "z")
    if run.phases.pushed is not None:
        return ("latency_s", "log_mass", "mu", "lifted")
    return ("latency_s",)


def _variance(missing: Sequence[np.ndarray], masks: Sequence[np.ndarray]) -> np.ndarray:
    """Variance of one residual times the autocorrelation time, by joint (J,)."""
    kept = np.concatenate([each[mask] for each, mask in zip(missing, masks, strict=True)])
    power = np.maximum((kept**2).mean(axis=0), LEAST**2)
    return np.asarray(power * autocorrelation_time(missing, masks, power))


def autocorrelation_time(missing: Sequence[np.ndarray], masks: Sequence[np.ndarray], power: np.ndarray) -> np.ndarray:
    """Integrated autocorrelation time (J,) of residuals [rows], at least 1: 1 + 2 sum of the correlations (Sokal 1997).

    The sum ends where the correlation first falls below 0.05. Residuals are not centred, so that an error that lasts a
    whole recording counts as one.

    Args:
        missing: Residuals (T, J) of every recording.
        masks: Rows (T,) that count.
        power: Mean square (J,) of the residuals.
    """
    longest = max(int(mask.sum()) for mask in masks)
    times, going = np.ones(len(power)), np.ones(len(power), bool)
    for lag in range(1, longest):
        products, count = np.zeros(len(power)), 0
        for each, mask in zip(missing, masks, strict=True):
            both = mask[lag:] & mask[:-lag]
            products += (each[lag:] * each[:-lag])[both].sum(axis=0)
            count += int(both.sum())
        if count == 0:
            break
        correlation = products / count / power
        going &= correlation > 0.05
        if not going.any():
            break
        times += np.where(going, 2.0 * correlation, 0.0)
    return times
