"""Which points of an operator's hand are those of a robot's: the palm's origin and the fingertips, both ways.

Retargeting goes from the operator to the robot; the program that makes hands from a robot's motion goes back, by the
same axes, points and scale. A constant offset between the two would move a palm wherever the hand turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import hands


@dataclass(frozen=True)
class Correspondence:
    """A robot's hand and one of an operator's, of known sizes."""

    side: str
    """The operator's hand: "left" or "right"."""
    roles: tuple[str, ...]
    """Frames of the robot's fingertips, the thumb's first."""
    fingers: tuple[int, ...]
    """Finger of the operator, as a place in `hands.FINGERS`, of each of these."""
    turn: np.ndarray
    """(3, 3) rotation from WebXR's axes of the operator's wrist to the frame of the robot's palm."""
    anchor: np.ndarray
    """(3,) mean first joint of the robot's fingers but the thumb, in the palm's frame [m]."""
    scale: float
    """Metre of the robot's hand per metre of the operator's."""

    @property
    def tips(self) -> list[int]:
        """The operator's joints that are the tips of these fingers."""
        return [hands.TIPS[finger] for finger in self.fingers]

    def robot_tips(self, points: np.ndarray) -> np.ndarray:
        """Tips (F, 3) in the frame of the robot's palm, at its scale, of joints (25, 3) of the operator [m]."""
        reach = (points[self.tips] - self._knuckle(points)) @ hands.palm_frame(points, self.side)
        return np.asarray(self.anchor + self.scale * reach @ self.turn.T)

    def human_tips(self, tips: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Tips (..., F, 3) of an operator whose palm is that of joints (25, 3), from a robot's in its palm's frame [m].

        The inverse of `robot_tips`.
        """
        reach = (tips - self.anchor) / self.scale @ self.turn
        return np.asarray(self._knuckle(points) + reach @ hands.palm_frame(points, self.side).T)

    def origin(self, points: np.ndarray) -> np.ndarray:
        """The point (3,) of the operator's hand (25, 3) that corresponds to the origin of the robot's palm [m].

        A wrist would not do: where a hand turns, its wrist and its palm move by different ways.
        """
        frame = hands.palm_frame(points, self.side)
        return np.asarray(self._knuckle(points) - frame @ self.turn.T @ self.anchor / self.scale)

    def axes(self, points: np.ndarray) -> np.ndarray:
        """Axes (3, 3) of the robot's palm on the operator's hand (25, 3)."""
        return np.asarray(hands.palm_frame(points, self.side) @ self.turn.T)

    def _knuckle(self, points: np.ndarray) -> np.ndarray:
        """Mean (3,) of the knuckles of the fingers but the thumb."""
        return np.asarray(points[[hands.KNUCKLES[finger] for finger in self.fingers[1:]]].mean(axis=0))
