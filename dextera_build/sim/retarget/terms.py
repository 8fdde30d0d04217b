"""DexPilot's terms of one hand as weighted residuals, for `geometry.least_squares`.

Vectors from the wrist to the tips and between the tips follow those of the operator (Handa et al., DexPilot, ICRA
2020); a robust loss and the weights are those that dex-retargeting states (optimizer.py, version 0.5.0). Two terms
differ from both: a pinch brings the *surfaces* of the fingertips together, not their frames, and parts that are not to
touch are kept apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from dextera_build.geometry import least_squares
from dextera_build.geometry.least_squares import Local, Normal
from dextera_build.sim.retarget.hand_model import CLEAR_M, HandModel, Seen
from dextera_build.sim.retarget.pinches import Pinch

HUBER_M = 0.03
"""Length of a residual above which its influence is constant [m]."""
BETWEEN = 0.3
"""Weight of a vector between two tips that do not pinch; dex-retargeting's is 1, with which tips of a hand of other
proportions miss their places by more."""
PINCHED = 200.0
"""Weight of the gap between two tips that pinch."""
APART, YIELDING_M = 400.0, 2.5e-4
"""Weight of the depth of parts that are not to touch, and depth above which its influence is constant [m]. A finger
held far from its place gives way: a thumb caught behind another finger would never come back."""
STAY, REST = 1e-2, 4e-4
"""Weights of a radian away from the last posture, and from the open hand."""


@dataclass(frozen=True)
class Goal:
    """What one message asks of the hand."""

    tips: np.ndarray
    """(F, 3) the operator's tips in the frame of the robot's palm [m]."""
    pinch: Pinch
    last: np.ndarray
    """(H,) last posture [rad]."""
    rest: np.ndarray
    """(H,) posture of the open hand [rad]."""


@dataclass(frozen=True)
class Terms:
    """Residuals at a posture."""

    seen: Seen
    vectors: np.ndarray
    """(V, 3) vectors of the robot minus those of the operator [m]."""
    gaps: np.ndarray
    """(F - 1,) gaps of fingers to the thumb minus those wanted [m]."""
    deep: np.ndarray
    """(K,) missing distance of close parts [m]."""
    stay: np.ndarray
    """(H,) posture minus the last one [rad]."""
    rest: np.ndarray
    """(H,) posture minus that of the open hand [rad]."""


class HandTerms:
    """The objective of one message; see `least_squares.Objective`.

    Args:
        hand: The robot's hand.
        goal: What the message asks.
    """

    def __init__(self, hand: HandModel, goal: Goal) -> None:
        self._hand, self._goal = hand, goal
        count = len(goal.tips)
        pairs = list(combinations(range(count), 2))
        unit = np.eye(count)
        self._vectors = np.concatenate([unit, [unit[other] - unit[one] for one, other in pairs]])
        self._wanted = self._vectors @ goal.tips
        pinch = goal.pinch
        # The vector of a pinching pair gives way to its gap; pairs with the thumb come first.
        between = np.full(len(pairs), BETWEEN)
        between[: count - 1] *= np.where(pinch.on, 1.0 - pinch.share, 1.0)
        self._weights = np.concatenate([np.full(count, float(len(pairs) + count)), between])
        # A pinch is firm where its gap is small; on the way there the hand follows the vectors.
        self._gaps = np.where(pinch.on, PINCHED * pinch.share, 0.0)
        self._thick = hand.radii[1:] + hand.radii[0]
        thumb, *others = hand.bodies.tolist()
        self._meeting = {frozenset((thumb, other)) for other, on in zip(others, pinch.on, strict=True) if on}

    def at(self, estimate: np.ndarray) -> Terms:
        """Residuals at a posture (H,)."""
        seen = self._hand.at(estimate)
        vectors = self._vectors @ seen.tips - self._wanted
        gaps = _lengths(seen.centres[1:] - seen.centres[0]) - self._thick - self._goal.pinch.gap_m
        free = [0.0 if frozenset(pair) in self._meeting else CLEAR_M for pair in seen.bodies.tolist()]
        deep = np.minimum(seen.close - np.array(free), 0.0)
        return Terms(seen, vectors, gaps, deep, estimate - self._goal.last, estimate - self._goal.rest)

    def value(self, seen: Terms, before: Terms) -> float:
        """Half the weighted sum of squares, with robust weights of `before`."""
        squares = np.einsum("vi,vi->v", seen.vectors, seen.vectors)
        # Parts come and go, so that they have no weights of `before`.
        inside = np.minimum(-seen.deep, YIELDING_M)
        return (
            float(
                self._robust(before) @ squares
                + self._gaps @ np.square(seen.gaps)
                + APART * (inside @ (-2 * seen.deep - inside))
                + STAY * (seen.stay @ seen.stay)
                + REST * (seen.rest @ seen.rest)
            )
            / 2
        )

    def local(self, estimate: np.ndarray, seen: Terms) -> Local:
        """Normal equations at the posture of the last `at`, without motors that push against their limits."""
        tips, centres, close = self._hand.moving()
        count, size = len(tips), len(estimate)
        vectors = (self._vectors @ tips.reshape(count, -1)).reshape(-1, size)
        weights = np.repeat(self._robust(seen), 3)
        away = seen.seen.centres[1:] - seen.seen.centres[0]
        away /= np.maximum(_lengths(away), 1e-9)[:, None]
        gaps = np.einsum("fi,fih->fh", away, centres[1:] - centres[0])
        rows = np.concatenate([vectors, gaps, close])
        off = -np.concatenate([seen.vectors.ravel(), seen.gaps, seen.deep])
        found = least_squares.normal(
            rows,
            off,
            np.concatenate([weights, self._gaps, APART * least_squares.huber(-seen.deep, YIELDING_M)]),
        )
        matrix = found.matrix + (STAY + REST) * np.eye(size)
        right = found.right - STAY * seen.stay - REST * seen.rest
        held = ((estimate <= self._hand.lower) & (right < 0)) | ((estimate >= self._hand.upper) & (right > 0))
        matrix[held] = matrix[:, held] = 0.0
        matrix[held, held] = 1.0
        return Local(Normal(matrix, np.where(held, 0.0, right)), np.diag(matrix).copy())

    def moved(self, estimate: np.ndarray, step: np.ndarray) -> np.ndarray:
        """The posture after a step, within the limits."""
        return np.asarray(np.clip(estimate + step, self._hand.lower, self._hand.upper))

    def _robust(self, seen: Terms) -> np.ndarray:
        return np.asarray(self._weights * least_squares.huber(_lengths(seen.vectors), HUBER_M))


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths (N,) of (N, 3); `np.linalg.norm` takes three times as long."""
    return np.asarray(np.sqrt(np.einsum("ni,ni->n", vectors, vectors)))
