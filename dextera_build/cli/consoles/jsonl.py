"""Events as they are, one JSON object a line, for programs."""

from __future__ import annotations

import threading
from typing import TextIO

from dextera_build.cli.consoles import Console
from dextera_build.runs.events import Event


class JsonlConsole(Console):
    """Writes `Event.to_line()`."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lock = threading.Lock()

    def __call__(self, event: Event) -> None:
        """Write one event."""
        with self._lock:
            self._stream.write(event.to_line() + "\n")
            self._stream.flush()

    def close(self) -> None:
        """Nothing is held back."""
