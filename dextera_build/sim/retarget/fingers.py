"""Motor positions of a robot's hand from the joints of an operator's, message by message."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import hands, least_squares
from dextera_build.sim.retarget.hand_model import CLEAR_M
from dextera_build.sim.retarget.low_pass import LowPass
from dextera_build.sim.retarget.matching import Matched
from dextera_build.sim.retarget.options import Retargeting
from dextera_build.sim.retarget.pinches import Pinches
from dextera_build.sim.retarget.terms import Goal, HandTerms

SPREADING = 4
"""Passes over neighbouring fingers that push their tips apart."""
FIRST = least_squares.Schedule(tries=60, damping=1e-2, still=1e-4)
"""From the open hand to the first message."""
NEXT = least_squares.Schedule(tries=8, taken=5, in_turn=3, damping=1e-3, gain=1e-3, still=1e-4)
"""From one message to the next."""


class Fingers:
    """One hand of a robot that follows one of an operator.

    Args:
        matched: Both hands.
        lengths_m: (5,) lengths of the operator's fingers, `hands.finger_lengths` [m].
        options: Constants.
    """

    def __init__(self, matched: Matched, lengths_m: np.ndarray, options: Retargeting) -> None:
        self.matched = matched
        self.beside = matched.beside(lengths_m, options.scale)
        """Points of the operator's hand that are those of the robot's."""
        self._pinches = Pinches(options, len(matched.fingers) - 1, self.beside.scale)
        self._thickness = matched.hand.radii[1:] + matched.hand.radii[0]
        self._filter = LowPass(options.low_pass_hz)
        self._posture: np.ndarray | None = None

    def next(self, points: np.ndarray, seconds: float) -> np.ndarray:
        """Motor positions (H,) [rad].

        Args:
            points: (25, 3) joints of the operator in any frame [m].
            seconds: Time since the last message; ignored at the first.
        """
        thumb, *others = points[self.beside.tips]
        apart = np.linalg.norm(others - thumb, axis=1)
        pinch = self._pinches.next(apart, self._thickness)
        rest = self.matched.straight
        last, schedule = (rest, FIRST) if self._posture is None else (self._posture, NEXT)
        terms = HandTerms(
            self.matched.hand, Goal(self._side_by_side(self.beside.robot_tips(points)), pinch, last, rest)
        )
        found, _ = least_squares.levenberg_marquardt(last, terms.at(last), terms, schedule)
        self._posture = found
        return self._filter.next(found, seconds)

    def _side_by_side(self, tips: np.ndarray) -> np.ndarray:
        """Tips (F, 3) of which neighbours but the thumb have room beside each other, where they are bent alike.

        Links of a robot are often wider than an operator's fingers.
        """
        found, own = tips.copy(), self.matched
        for _ in range(SPREADING):
            for one in range(1, len(found) - 1):
                away, room = found[one + 1] - found[one], own.widths[one] + own.widths[one + 1] + CLEAR_M
                beside = float(away @ own.across)
                ahead = float(np.linalg.norm(away - beside * own.across))
                share = min(max(2.0 - ahead / room, 0.0), 1.0)
                push = share * max(room - beside, 0.0) / 2 * own.across
                found[one], found[one + 1] = found[one] - push, found[one + 1] + push
        return np.asarray(found)


def measured(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Lengths (5,) [m] of an operator's fingers: medians over the messages `valid` (N,) of points (N, 25, 3)."""
    return np.asarray(np.median(hands.finger_lengths(points[valid]), axis=0))
