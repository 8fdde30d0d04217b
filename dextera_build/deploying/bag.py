"""The recording of a run: every message that was read or sent, interventions and versions, as an MCAP file of ROS 2."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO

from dextera_build.deploying.transport import Topic
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import Recording

INTERVENTIONS = Topic("/dxb/interventions", "std_msgs/String")
"""Targets that the guard changed, and why it stopped."""
VERDICTS = Topic("/dxb/verdict", "std_msgs/String")
"""Success by the measurements, and by the operator."""

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

    @classmethod
    def create(cls, path: Path) -> Bag:
        """A recording in a new file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        return cls(path.open("wb"))

    def add(self, topic: Topic, time: int, message: bytes) -> None:
        """Write a message; a failure is noted, because the thread of a transport cannot act on it."""
        with self._lock:
            if not self._open or self.fault:
                return
            try:
                self._recording.send(topic.name, topic.kind, time, message)
            except OSError as error:
                self.fault = f"the recording cannot be written: {error.strerror or error}"

    def say(self, topic: Topic, time: int, words: str) -> None:
        """Write a text."""
        self.add(topic, time, messages.text(words))

    def close(self, facts: Mapping[str, str]) -> None:
        """Write facts about the run, such as versions, and the index; what was written before a failure is kept."""
        with self._lock:
            self._open = False
            with suppress(OSError):
                self._recording.metadata("dxb", facts)
                self._recording.finish()
            with suppress(OSError):
                self._out.close()
