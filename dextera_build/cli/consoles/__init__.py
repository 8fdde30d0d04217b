"""Progress output of builds. Every console listens to the event stream and writes to one stream."""

from __future__ import annotations

import os
import threading
from types import TracebackType
from typing import Self, TextIO

from dextera_build.cli.consoles.record import Record
from dextera_build.cli.errors import wants_colour
from dextera_build.cli.streams import StreamError
from dextera_build.runs.events import Event, RunFinished

_NARROW = 40  # columns; a narrower terminal has no room for a live footer


class Console:
    """A listener that may control the terminal until it is closed; also a context manager, which closes it.

    The base class is the console `none`, which prints failures only.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._colour = wants_colour(stream)
        self._lock = threading.RLock()
        self.record = Record()

    def __call__(self, event: Event) -> None:
        """Show one event.

        Raises:
            StreamError: The stream cannot be written.
        """
        try:
            self._show(event)
        except OSError as error:
            raise StreamError(str(error)) from error

    def close(self) -> None:
        """Flush held lines and restore the terminal; may be called twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except OSError:
            if error is None:
                raise

    def _show(self, event: Event) -> None:
        self.record.follow(event)
        if isinstance(event, RunFinished):
            for block in self.record.failures(colour=self._colour):
                self._stream.write(block + "\n")
            self._stream.flush()


class JsonlConsole(Console):
    """Writes events unchanged, one JSON object per line."""

    def _show(self, event: Event) -> None:
        with self._lock:
            self._stream.write(event.to_line() + "\n")
            self._stream.flush()


def console(kind: str, stream: TextIO, *, verbose: bool = False) -> Console:
    """Create the console `kind`; `live` and `auto` fall back to `plain` if `stream` cannot redraw lines.

    Args:
        kind: A value of the setting `console`.
        stream: Usually standard error; standard output is for results.
        verbose: Also show the lines that nodes log.
    """
    if kind in ("none", "jsonl"):
        return JsonlConsole(stream) if kind == "jsonl" else Console(stream)
    if kind != "plain" and can_move(stream):
        from dextera_build.cli.consoles.live import LiveConsole

        return LiveConsole(stream, verbose=verbose)
    from dextera_build.cli.consoles.plain import PlainConsole

    return PlainConsole(stream, verbose=verbose)


def can_move(stream: TextIO) -> bool:
    """Whether `stream` can redraw lines: a terminal that is wide enough and not `dumb`."""
    if not stream.isatty() or os.environ.get("TERM") == "dumb":
        return False
    try:
        return os.get_terminal_size(stream.fileno()).columns >= _NARROW
    except (OSError, ValueError):
        return False
