"""Size of the operator's hands: lengths of the fingers over two seconds in which the hands are open."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST
from dextera_build.geometry import hands
from dextera_build.sim.experts.live_operator import Message
from dextera_build.teleop import posture

STRAIGHT = 0.9
"""Distance from knuckle to tip relative to the length of the bones between, from which on a finger is straight."""
GAP_S = 0.5
"""Longest time between messages that counts as open [s]."""


class Measure:
    """Lengths of both hands' fingers from messages; a hand that bends begins anew."""

    SECONDS = 2.0
    """Time for which a hand must be open [s]."""

    def __init__(self) -> None:
        self._rows: list[list[np.ndarray]] = [[], []]
        self._time = [0.0, 0.0]
        self._last = [np.nan, np.nan]
        self._found = np.full((2, 5), np.nan)
        self._assumed = False

    def add(self, message: Message) -> None:
        """Take note of the hands of a message."""
        for hand, side in enumerate(hands.SIDES):
            if self.done(side) or message.tracking[hand] == LOST:
                continue
            points = message.positions[hand].astype(np.float64)
            gap, self._last[hand] = message.arrived - self._last[hand], message.arrived
            if not is_open(points):
                self._rows[hand], self._time[hand] = [], 0.0
                continue
            self._time[hand] += gap if gap < GAP_S else 0.0
            self._rows[hand].append(hands.finger_lengths(points))
            if self._time[hand] >= self.SECONDS:
                self._found[hand] = np.median(self._rows[hand], axis=0)

    def of(self, *, measured: bool) -> None:
        """Whether joints are measured; those that `posture` makes have its hands' size. A change begins anew."""
        if measured == self._assumed:
            self._assumed = not measured
            self._found = np.full((2, 5), np.nan) if measured else posture.lengths()

    def share(self, side: str) -> float:
        """How much of the measurement of a hand is done, 0 to 1."""
        hand = hands.SIDES.index(side)
        return 1.0 if self.done(side) else min(self._time[hand] / self.SECONDS, 1.0)

    def done(self, side: str) -> bool:
        """Whether a hand is measured."""
        return bool(np.isfinite(self._found[hands.SIDES.index(side)]).all())

    def lengths_m(self) -> np.ndarray:
        """Lengths (2, 5) [m]; NaN of a hand that is not measured."""
        return self._found.copy()


def is_open(points: np.ndarray) -> bool:
    """Whether the four fingers of a hand (25, 3) are straight."""
    reach = np.linalg.norm(points[list(hands.TIPS[1:])] - points[list(hands.KNUCKLES[1:])], axis=-1)
    return bool((reach > STRAIGHT * hands.finger_lengths(points)[1:]).all())
