"""Measurements of one topic in the order of their stamps, with the offset of its clock and their delay."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

from dextera_build.formats.ros.reading import SECOND

KEPT_S = 2.0
"""Time for which measurements are kept [s]."""
LATE_NS = SECOND // 2
"""Time by which a stamp is ahead of every delay, or behind the one before, if a clock was set [ns]."""

EARLY_S, SLOW_S = 0.05, 0.2
"""Time by which messages of a camera may come earlier, and later, than joint states with the same stamps [s]."""
DRIFT = 1e-4
"""Difference of the rates of two clocks, by which an offset is forgotten."""


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
        kept_s: Time for which measurements are kept [s].
        of: The object that is measured, if the topic has several.
        strict: Whether a clock that is set is a fault; otherwise measurements begin anew, for those who move nothing.
        steady: Whether delays are short, so that a stamp that is far ahead of them shows a clock that was set. Those of
            cameras and trackers are not, whose first answers may take a second; see `unfit`.
    """

    def __init__(
        self, topic: str, kept_s: float = KEPT_S, of: str = "", *, strict: bool = True, steady: bool = True
    ) -> None:
        self.topic, self.of = topic, of
        self.name = f"{topic} of {of}" if of else topic
        """What it is called in messages."""
        self.fault = ""
        """Why it must not be used any more; empty if it may be."""
        self.count = 0
        self.stale = 0
        """Number of measurements that arrived after newer ones."""
        self._strict, self._steady = strict, steady
        self._samples, self._kept = deque[Sample](), round(kept_s * SECOND)
        self._offset: int | None = None
        self._at = 0
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
            self._offset = self._smallest(sample.arrived, difference)
            if self._samples and sample.stamp < self._samples[-1].stamp:
                self.stale += 1
                return
            self._samples.append(sample)
            # By arrival, because stamps may be missing.
            while sample.arrived - self._samples[0].arrived > self._kept:
                self._samples.popleft()

    def _smallest(self, arrived: int, difference: int) -> int:
        """The smallest difference of arrival and stamp [ns]; it grows slowly, because clocks drift."""
        before, self._at = self._at, arrived
        if self._offset is None:
            return difference
        return min(self._offset + round(DRIFT * max(0, arrived - before)), difference)

    def _jump(self, sample: Sample, offset: int) -> int:
        """By how much the clock of the stamps was set [ns]; 0: not at all. A message that is late shows nothing."""
        ahead = offset - (sample.arrived - sample.stamp)
        back = self._samples[-1].stamp - sample.stamp if self._samples else 0
        if back > LATE_NS:
            # The clock here is set, too, where both are that of one machine.
            return ahead if abs(ahead) > LATE_NS else -back
        return ahead if ahead > LATE_NS and self._steady else 0

    def broken(self, why: str) -> None:
        """Note a message that cannot be used."""
        self.fault = self.fault or f"a message of `{self.name}` cannot be used: {why}"

    @property
    def last(self) -> Sample | None:
        """The newest measurement."""
        with self._lock:
            return self._samples[-1] if self._samples else None

    def samples(self) -> tuple[Sample, ...]:
        """The measurements that are kept, oldest first."""
        with self._lock:
            return tuple(self._samples)

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

    def old(self, now: int, most_s: float) -> str:
        """Why the newest measurement must not be used any more, `most_s` after it was made; empty if it may be."""
        if self.silent_s(now) > most_s:
            return f"no frame arrived for more than {most_s:g} s on {self.name}"
        if (age_s := self.age_s(now)) > most_s:
            return f"the newest frame on {self.name} is {age_s:.2f} s old, more than {most_s:g} s"
        return ""

    def unfit(self, than: Stream, early_s: float = EARLY_S, slow_s: float = SLOW_S) -> str:
        """How much earlier or later its messages come than those of another stream with the same stamps.

        Offsets contain delays, so that a clock that is behind and a slow sensor look alike.

        Args:
            than: The other stream.
            early_s: Allowed time [s].
            slow_s: Allowed time [s].
        """
        behind_s = self.offset_s - than.offset_s
        if -early_s <= behind_s <= slow_s:
            return ""
        how = f"{behind_s:.2f} s later" if behind_s > 0 else f"{-behind_s:.2f} s earlier"
        return f"{self.name} comes {how} than {than.name} with the same stamps: its clock is another, or it is slow"

    def rate_hz(self) -> float:
        """Rate of the kept measurements by their stamps [Hz]; 0 for fewer than two."""
        with self._lock:
            if len(self._samples) < 2:
                return 0.0
            span = (self._samples[-1].stamp - self._samples[0].stamp) / SECOND
            return (len(self._samples) - 1) / span if span > 0 else 0.0
