"""Notices a camera whose driver repeats one picture with new stamps while the robot moves."""

from __future__ import annotations

import zlib

import numpy as np

from dextera_build.formats.ros.reading import SECOND

MOVED_RAD = 0.05
"""Motion of a joint in which a picture must change [rad or m]; at rest, a simulated camera repeats itself rightly."""


class Frozen:
    """The pictures of one camera.

    Args:
        limit_s: Time for which the same picture may come while the robot moves [s].
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._seen, self._since = -1, 0
        self._joints: np.ndarray | None = None

    def add(self, picture: bytes, arrived: int, joints: np.ndarray | None) -> bool:
        """Whether the camera is frozen.

        Args:
            picture: The compressed picture.
            arrived: When it arrived [ns].
            joints: Joint positions (A,) [rad or m]; None: not known yet.
        """
        seen = zlib.crc32(picture)
        if seen != self._seen or self._joints is None:
            self._seen, self._since, self._joints = seen, arrived, joints
            return False
        moved = joints is not None and np.abs(joints - self._joints).max(initial=0.0) > MOVED_RAD
        return bool(moved and (arrived - self._since) / SECOND > self._limit_s)
