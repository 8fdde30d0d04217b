"""Silence, except for failures."""

from __future__ import annotations

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

    def close(self) -> None:
        """Nothing is held back."""
