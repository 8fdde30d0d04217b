"""Measurements of one topic in the order of their stamps, with the offset of its clock and their delay."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

from dextera_build.formats.ros.reading import SECOND

KEPT = 200
"""Number of measurements that are kept, two seconds of joint states."""
LATE_NS = SECOND // 2
"""Time by which a stamp is ahead of every delay, or behind the one before, if a clock was set [ns]."""


@dataclass(frozen=True)
class Sample:
    """A measurement."""

    stamp: int
    """When it was made, by the clock of the robot [ns]."""
    arrived: int
    """When it arrived, by the clock of this machine [ns]."""
    value: Any
    """What was measured."""


class Stream:
    """Measurements of one topic.

    Stamps are those of the robot's clock, which may differ from the one here. The offset is the smallest difference of
    arrival and stamp so far: the difference of both clocks plus the shortest delay, which cannot be told apart.

    Args:
        topic: Its name.
        depth: Number of measurements that are kept.
        of: The object that is measured, if the topic has several.
        strict: Whether a clock that is set is a fault; otherwise measurements begin anew, for those who move nothing.
    """

    def __init__(self, topic: str, depth: int = KEPT, of: str = "", *, strict: bool = True) -> None:
        self.topic, self.of = topic, of
        self.name = f"{topic} of {of}" if of else topic
        """What it is called in messages."""
        self.fault = ""
        """Why it must not be used any more; empty if it may be."""
        self.count = 0
        self.stale = 0
        """Number of measurements that arrived after newer ones."""
        self._strict = strict
        self._samples: deque[Sample] = deque(maxlen=depth)
        self._offset: int | None = None
        self._lock = threading.Lock()

    def add(self, sample: Sample) -> None:
        """Add a measurement; a stamp that shows that a clock was set is a fault."""
        with self._lock:
            self.count += 1
            difference = sample.arrived - sample.stamp
            if self._offset is not None and (jump := self._jump(sample, self._offset)):
                if self._strict:
                    self.fault = self.fault or f"the stamps of `{self.name}` jumped by {jump / SECOND:+.2f} s"
                    return
                self._samples.clear()
                self._offset = None
            self._offset = difference if self._offset is None else min(self._offset, difference)
            if self._samples and sample.stamp < self._samples[-1].stamp:
                self.stale += 1
                return
            self._samples.append(sample)

    def _jump(self, sample: Sample, offset: int) -> int:
        """By how much the clock of the stamps was set [ns]; 0: not at all. A message that is late shows nothing."""
        ahead = offset - (sample.arrived - sample.stamp)
        if ahead > LATE_NS or (self._samples and self._samples[-1].stamp - sample.stamp > LATE_NS):
            return ahead
        return 0

    def broken(self, why: str) -> None:
        """Note a message that cannot be used."""
        self.fault = self.fault or f"a message of `{self.name}` cannot be used: {why}"

    @property
    def last(self) -> Sample | None:
        """The newest measurement."""
        with self._lock:
            return self._samples[-1] if self._samples else None

    def nearest(self, stamp: int) -> Sample | None:
        """The measurement whose stamp is nearest."""
        with self._lock:
            return min(self._samples, key=lambda each: abs(each.stamp - stamp), default=None)

    @property
    def offset_s(self) -> float:
        """Offset of the clock here from the one of the stamps, with the shortest delay [s]; 0 before the first one."""
        return (self._offset or 0) / SECOND

    def late_s(self) -> float:
        """Delay of the newest measurement beyond the shortest one [s]; infinite if there is none."""
        last = self.last
        return float("inf") if last is None else (last.arrived - last.stamp - (self._offset or 0)) / SECOND

    def age_s(self, now: int) -> float:
        """Time since the newest measurement was made, less the shortest delay [s]; infinite if there is none."""
        last = self.last
        return float("inf") if last is None else (now - last.stamp - (self._offset or 0)) / SECOND

    def silent_s(self, now: int) -> float:
        """Time since a measurement arrived [s]; infinite if none did."""
        last = self.last
        return float("inf") if last is None else (now - last.arrived) / SECOND

    def rate_hz(self) -> float:
        """Rate of the kept measurements by their stamps [Hz]; 0 for fewer than two."""
        with self._lock:
            if len(self._samples) < 2:
                return 0.0
            span = (self._samples[-1].stamp - self._samples[0].stamp) / SECOND
            return (len(self._samples) - 1) / span if span > 0 else 0.0
