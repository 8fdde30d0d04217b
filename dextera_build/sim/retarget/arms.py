"""Targets of a palm from poses of an operator's hand, relative to where both were when the clutch closed."""

from __future__ import annotations

import numpy as np

from dextera_build.geometry import lie, transforms
from dextera_build.sim.retarget.options import Retargeting


class Palm:
    """One palm that follows a wrist while the clutch is closed.

    Args:
        palm: (4, 4) T_base_palm at the start.
        options: Constants.
    """

    def __init__(self, palm: np.ndarray, options: Retargeting) -> None:
        self._options = options
        self._turn = lie.about_z(options.heading_rad or 0.0)
        self._palm = np.array(palm, np.float64)
        self._start = (self._palm, np.eye(4))
        self._last: np.ndarray | None = None

    def next(self, wrist: np.ndarray | None) -> tuple[np.ndarray, bool]:
        """The target (4, 4) T_base_palm, and whether it is held.

        The first wrist after a hold is the new reference, so that the palm never jumps to it. A wrist that jumps
        against the last message is not followed.

        Args:
            wrist: (4, 4) rotation of the wrist at the place of `Fingers.origin`, in a frame with z up; None: the clutch
                is open, or tracking is lost.
        """
        last, self._last = self._last, None if wrist is None else np.array(wrist, np.float64)
        if self._last is None:
            return self._palm.copy(), True
        if last is None or self._jumps(last, self._last):
            self._start = (self._palm, self._last)
            return self._palm.copy(), True
        palm, reference = self._start
        moved = self._turn @ (self._last[:3, 3] - reference[:3, 3])
        rotated = self._turn @ self._last[:3, :3] @ reference[:3, :3].T @ self._turn.T
        place = palm[:3, 3] + self._options.arm_scale * moved
        self._palm = transforms.rigid(rotated @ palm[:3, :3], place)
        return self._palm.copy(), False

    def _jumps(self, last: np.ndarray, now: np.ndarray) -> bool:
        far = float(np.linalg.norm(now[:3, 3] - last[:3, 3])) > self._options.jump_m
        return far or transforms.angle(last[:3, :3].T @ now[:3, :3]) > self._options.jump_rad


def heading(head: np.ndarray) -> float:
    """Angle about z [rad] that turns the horizontal direction ahead of an operator to x, the robot's ahead.

    Args:
        head: (3, 3) rotation of the head in a frame with z up, with WebXR's axes: -Z ahead.
    """
    return float(-np.arctan2(-head[1, 2], -head[0, 2]))
