"""Joint states of a robot whose drivers publish those of their own joints, as arm and hand often do.

The state is whole once every joint was heard, and as old as the joint that was heard longest ago. Drivers of other
joints are ignored. Once one message had all joints, every message has to.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from dextera_build.deploying.stream import Sample, Stream
from dextera_build.deploying.wire import Joints, UnusableError, stamp_of, unpacked
from dextera_build.errors import listing


class Merged:
    """The newest position of every joint.

    Args:
        joints: Reads joint states.
    """

    def __init__(self, joints: Joints) -> None:
        self._joints = joints
        self._latest: dict[str, Sample] = {}
        self._together: bool | None = None
        self._given = 0
        self._lock = threading.Lock()
        self.lacks = ""
        """Which joints were not heard so far; empty if all were."""

    def read(self, kind: str, message: bytes, arrived: int, into: Stream) -> None:
        """Add a message to a stream of whole states, or note there that it cannot be used."""
        try:
            state = unpacked(kind, message)
            sample = self.add(state, stamp_of(state.header), arrived)
        except UnusableError as error:
            into.broken(str(error))
            return
        if sample is not None:
            into.add(sample)

    def add(self, state: Any, stamp: int, arrived: int) -> Sample | None:
        """The state (A,) [rad or m] after an unpacked joint state arrived; None: it is not whole, or not newer.

        Raises:
            UnusableError: A position is not finite, or a message lacks a joint that all messages before had.
        """
        found = self._joints.found(state)
        with self._lock:
            if self._together is None and found:
                self._together = len(found) == len(self._joints.names)
            if self._together:
                self.lacks = ""
                if not found:
                    return None
                return Sample(stamp, arrived, self._joints.positions(state))
            self._latest |= {name: Sample(stamp, arrived, place) for name, place in found.items()}
            missing = [name for name in self._joints.names if name not in self._latest]
            self.lacks = f"it lacks {listing(missing)}; it has {listing(state.name, most=40)}" if missing else ""
            oldest = min(self._latest.values(), key=lambda each: each.stamp, default=None)
            if missing or oldest is None or oldest.stamp == self._given:
                return None
            self._given = oldest.stamp
            return Sample(
                oldest.stamp, oldest.arrived, np.array([self._latest[name].value for name in self._joints.names])
            )

    def silent(self, since: int) -> str:
        """The joints that were not heard since a time [ns], ` of x, y`, if others were; empty if none was."""
        with self._lock:
            names = [name for name, each in self._latest.items() if each.arrived < since]
            return f" of {listing(names)}" if len(names) < len(self._latest) else ""
