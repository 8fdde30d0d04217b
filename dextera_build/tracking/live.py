"""Tracking from a live camera: always the newest frame, within a budget of time.

```python
for seen in live.follow(tracker, camera(), budget_s=1 / 15):
    print(seen.stamp, seen.found["mug"].status, seen.delay_s)
```

A thread waits for frames and keeps the newest; frames that arrive while the tracker is busy are dropped, so that the
delay of a pose is at most two frame intervals plus the processing time of one frame.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dextera_build.geometry import transforms
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker


class Shot(Protocol):
    """A frame of a camera, such as `artifacts.rgbd_video.RgbdFrame`."""

    @property
    def stamp(self) -> float:
        """Time [s]."""
        ...

    @property
    def rgb(self) -> np.ndarray:
        """(H, W, 3) uint8 sRGB."""
        ...

    @property
    def depth(self) -> np.ndarray:
        """(H, W) image-plane z [m], registered to `rgb`; 0 where nothing was measured."""
        ...

    @property
    def pose(self) -> np.ndarray | None:
        """T_world_camera (4, 4), OpenCV axes; None if the camera's motion is unknown and must be estimated."""
        ...


@dataclass(frozen=True)
class Seen:
    """The poses of one frame."""

    stamp: float
    """Time of the frame [s]."""
    found: dict[str, Tracked]
    """Name -> state of the object."""
    delay_s: float
    """Time from the arrival of the frame until now [s]."""
    dropped: int
    """Number of frames dropped since the last one."""


def follow(tracker: Tracker, source: Iterable[Shot], budget_s: float | None = None) -> Iterator[Seen]:
    """Track objects in the newest frame of a source, until it ends.

    Args:
        tracker: A tracker with the objects' states in the first frame (`Tracker.start`).
        source: Blocks until the next frame. It is read by a separate thread, and may be endless.
        budget_s: Time for one frame [s], after which lost objects are searched in later frames; None without.

    Raises:
        Exception: Any exception of the source, after its earlier frames were processed.
    """
    newest = _Newest(source)
    before: np.ndarray | None = None
    try:
        while (taken := newest.take()) is not None:
            shot, arrived, dropped = taken
            moved = None
            if shot.pose is not None:
                moved = np.eye(4) if before is None else transforms.invert(shot.pose) @ before
            before = shot.pose
            found = tracker.step(shot.rgb, shot.depth, shot.stamp, moved=moved, budget_s=budget_s)
            yield Seen(shot.stamp, found, time.monotonic() - arrived, dropped)
    finally:
        newest.close()


class _Newest:
    """The newest frame of a source, and the number of frames that it replaced."""

    def __init__(self, source: Iterable[Shot]) -> None:
        self._changed = threading.Condition()
        self._shot: Shot | None = None
        self._arrived, self._dropped = 0.0, 0
        self._ended = self._closed = False
        self._error: BaseException | None = None
        threading.Thread(target=self._read, args=(source,), name="camera", daemon=True).start()

    def take(self) -> tuple[Shot, float, int] | None:
        """A frame, its arrival time (`time.monotonic`) and the number of frames dropped before it; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._shot is not None or self._ended)
            if self._shot is None:
                if self._error is not None:
                    raise self._error
                return None
            taken = self._shot, self._arrived, self._dropped
            self._shot, self._dropped = None, 0
            return taken

    def close(self) -> None:
        """Stop reading after the next frame."""
        self._closed = True

    def _read(self, source: Iterable[Shot]) -> None:
        try:
            for shot in source:
                if self._closed:
                    return
                with self._changed:
                    self._dropped += self._shot is not None
                    self._shot, self._arrived = shot, time.monotonic()
                    self._changed.notify()
        except Exception as error:
            self._error = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()
