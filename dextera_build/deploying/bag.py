"""The recording of a run: every message that was read or sent, interventions and versions, as an MCAP file of ROS 2."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import LATCHED, Recording, check_new
from dextera_build.geometry import poses
from dextera_build.policy import robot_run
from dextera_build.sim.observe.shapes import Shapes

INTERVENTIONS = Topic("/dxb/interventions", "std_msgs/String")
"""Targets that the guard changed, and why it stopped."""
ABOUT = Topic(robot_run.ABOUT, "std_msgs/String")
"""Facts about the run, at its beginning."""
VERDICT = Topic(robot_run.VERDICT, "std_msgs/String")
"""Success by the measurements, and by the operator."""
SUMMARY = Topic("/dxb/summary", "std_msgs/String")
"""What happened in the run, at its end: why it ended, delays, jitter, missed periods."""

BASE = "base"
"""Frame of poses, the robot's base."""
CHUNK_BYTES = 1 << 15
"""Size of a chunk: what a crash can lose, two seconds of joint states."""


class Bag:
    """A recording that is being written, by several threads.

    Args:
        out: The file.
    """

    def __init__(self, out: IO[bytes]) -> None:
        self._out = out
        # Pictures are compressed already, and nothing may delay a control period.
        self._recording = Recording(out, "none", CHUNK_BYTES)
        self._lock = threading.Lock()
        self._open = True
        self.fault = ""
        """Why nothing more can be written; empty if it can."""
        self.periods = 0
        """Number of control periods whose targets it holds."""
        self._shapes: Shapes | None = None

    @classmethod
    def create(cls, path: Path) -> Bag:
        """A recording in a new file.

        Raises:
            UsageError: There is such a file, or it cannot be written.
        """
        check_new(path)
        return cls(path.open("xb"))

    def add(self, topic: Topic, time: int, message: bytes) -> None:
        """Write a message; a failure is noted, because the thread of a transport cannot act on it."""
        self._write(lambda recording: recording.send(topic.name, topic.kind, time, message))

    def describe(self, bundle: TaskBundle, time: int) -> None:
        """Write what viewers draw: the robot's description, shapes of objects and room, and frames that never move.

        Args:
            bundle: The task.
            time: When the run begins [ns].
        """
        shapes = Shapes(bundle)
        fixed = [("world", BASE, poses.from_matrix(bundle.base_pose.matrix)), *shapes.fixed({})]

        def write(recording: Recording) -> None:
            shapes.send(recording, time, {})
            recording.send("/tf_static", "tf2_msgs/TFMessage", time, messages.transforms(time, fixed), LATCHED)

        self._write(write)
        self._shapes = shapes

    def links(self, joints: Mapping[str, float]) -> list[tuple[str, str, np.ndarray]]:
        """Parent, child and pose (7,) of the moving links of robot and objects; none before `describe`.

        Args:
            joints: Joint -> position [rad or m].
        """
        if self._shapes is None:
            return []
        known = {name: np.array([place]) for name, place in joints.items() if np.isfinite(place)}
        return [(parent, child, rows[0]) for parent, child, rows in self._shapes.moving(known, {})]

    def _write(self, write: Callable[[Recording], None]) -> None:
        with self._lock:
            if not self._open or self.fault:
                return
            try:
                write(self._recording)
            except OSError as error:
                self.fault = f"the recording cannot be written: {error.strerror or error}"

    def say(self, topic: Topic, time: int, words: str) -> None:
        """Write a text."""
        self.add(topic, time, messages.text(words))

    def state(self, topic: Topic, time: int, facts: Mapping[str, Any]) -> None:
        """Write plain data as a JSON object, which copies of the recording and `mcap recover` keep."""
        self.say(topic, time, json.dumps(facts))

    def close(self) -> None:
        """Write the index; what was written before a failure is kept."""
        with self._lock:
            self._open = False
            with suppress(OSError):
                self._recording.finish()
            with suppress(OSError):
                self._out.close()
