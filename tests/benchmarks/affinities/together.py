"""Print how much the log odds of both networks of `rules.factorize.regions.bonds` count: OWN, SAID and SHIFT.

    python -m tests.benchmarks.affinities.together

By logistic regression over pairs of groups that touch, in rooms from which neither network learned. A join of two
objects loses both, therefore such pairs count as in `tests.benchmarks.bonds`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize

from rules.factorize.regions import bonds as rule
from tests.benchmarks import bonds
from tests.benchmarks.affinities import pictures, things

ROOMS = range(9000, 9012)
LEAST_M2 = 0.0004
"""Smaller groups are noise [m^2]."""


def main() -> None:
    """Draw, fit, print."""
    rows = np.array([row for seed in ROOMS for row in samples(seed)])
    found = fit(rows[:, :-1], rows[:, -1] > 0)
    values = [round(float(value), 3) for value in found]
    print(f"{len(rows)} pairs: OWN {values[0]}, SAID {values[1:-1]}, SHIFT {values[-1]}")


def samples(seed: int) -> Iterator[list[float]]:
    """Log odds of the first network, means of the second one's at each reach, and 1 for one object."""
    rng = np.random.default_rng(seed)
    for seen, labels in pictures.scenes(seed, things.learned):
        for parts, a, b, same in bonds.touching(seen, labels, rng, asked=True):
            one, other, contact = parts.groups[a], parts.groups[b], parts.contacts[a, b]
            if min(one.area_m2, other.area_m2) > LEAST_M2:
                yield [parts.bonds.alone(one, other, contact), *rule.means(contact.said), float(same)]


def fit(values: np.ndarray, same: np.ndarray) -> np.ndarray:
    """Weights (F + 1,) of values (N, F) and of a constant, for the log odds of `same` (N,) bool."""
    design = np.column_stack([values, np.ones(len(values))])
    weight, sign = np.where(same, 1.0, bonds.APART_WEIGHT), np.where(same, 1.0, -1.0)

    def error(weights: np.ndarray) -> float:
        return float((weight * np.logaddexp(0.0, -sign * (design @ weights))).mean() + 1e-4 * (weights**2).sum())

    return np.asarray(minimize(error, np.zeros(design.shape[1])).x)


if __name__ == "__main__":
    main()
