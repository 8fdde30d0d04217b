"""Consoles for programs: failures alone, or every event as JSON."""

from __future__ import annotations

import threading
from typing import TextIO

from dextera_build.cli.consoles import Console
from dextera_build.cli.consoles.record import Record
from dextera_build.cli.errors import wants_colour
from dextera_build.runs.events import Event, RunFinished


class QuietConsole(Console):
    """Says nothing of a build that succeeds."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._record = Record()

    def __call__(self, event: Event) -> None:
        """Print failed nodes when the run ends."""
        self._record.follow(event)
        if isinstance(event, RunFinished):
            for block in self._record.failures(colour=wants_colour(self._stream)):
                self._stream.write(block + "\n")
            self._stream.flush()


class JsonlConsole(Console):
    """Writes events as they are, one JSON object a line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lock = threading.Lock()

    def __call__(self, event: Event) -> None:
        """Write one event."""
        with self._lock:
            self._stream.write(event.to_line() + "\n")
            self._stream.flush()
