"""Play, pause and step in real time, in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

FRAME_S = 0.04
"""Time between two pictures [s]."""


class Transport:
    """Moves something forward in real time while it plays.

    Args:
        period_s: Time of one step [s].
        forward: Takes one step; False if that was the last one, which pauses.
        show: Shows the present state.
    """

    def __init__(self, period_s: float, forward: Callable[[], bool], show: Callable[[], None]) -> None:
        self._period_s, self._forward, self._show = period_s, forward, show
        self.lock = threading.RLock()
        """Lock of the state: hold it to step, or to change the state from another thread."""
        self.speed = 1.0
        """Requested simulated time per real time."""
        self.reached = 0.0
        """Simulated time per real time of late."""
        self._playing, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="transport", daemon=True)
        self._thread.start()

    @property
    def playing(self) -> bool:
        """Whether it moves."""
        return self._playing.is_set()

    def play(self) -> None:
        """Go on."""
        self._playing.set()

    def pause(self) -> None:
        """Stay where it is."""
        self._playing.clear()

    def step(self) -> None:
        """Take one step, and pause."""
        self.pause()
        with self.lock:
            self._forward()
            self._show()

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self._playing.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while not self._ended.is_set():
            self._playing.wait()
            last, owed = time.perf_counter(), 0.0
            while self.playing and not self._ended.is_set():
                began = time.perf_counter()
                owed = min(owed + (began - last) * self.speed, 0.5)
                passed, last = began - last, began
                taken = self._take(owed, began + FRAME_S)
                owed -= taken * self._period_s
                rate = taken * self._period_s / max(passed, FRAME_S)
                self.reached += 0.1 * (rate - self.reached)
                time.sleep(max(0.0, FRAME_S - (time.perf_counter() - began)))

    def _take(self, owed_s: float, until: float) -> int:
        """Take the steps that are due, as far as there is time; their number."""
        taken = 0
        with self.lock:
            while (taken + 1) * self._period_s <= owed_s + 1e-9 and self.playing:
                taken += 1
                if not self._forward():
                    self.pause()
                if time.perf_counter() > until:
                    break
            if taken:
                self._show()
        return taken
