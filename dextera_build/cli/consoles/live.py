"""The build on a terminal: finished nodes scroll by, running nodes stand at the foot with a clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TextIO

from rich.console import Console as Terminal
from rich.live import Live
from rich.text import Text

from dextera_build.cli.consoles import Console, lines
from dextera_build.cli.consoles.foot import counted, foot
from dextera_build.cli.consoles.lines import Columns, Line
from dextera_build.cli.consoles.record import Record, clock
from dextera_build.cli.errors import wants_colour
from dextera_build.runs.events import (
    Event,
    NodeFinished,
    NodeStarted,
    RemoteGivenUp,
    RunFinished,
    RunStarted,
    Uploading,
)

_DEBOUNCE_S = 0.05  # events within it are drawn together: ten thousand cached nodes must not draw ten thousand times
_TICK_S = 0.25  # a clock that stands still looks hung
_PATIENCE_S = 0.4  # a build that runs nothing and ends sooner shows its last line only


class LiveConsole(Console):
    """Draws from a thread of its own, so that a busy engine does not stop the clocks."""

    def __init__(
        self,
        stream: TextIO,
        *,
        verbose: bool = False,
        now: Callable[[], float] = time.time,
        terminal: Terminal | None = None,
    ) -> None:
        self._colour = wants_colour(stream)
        self._terminal = terminal or Terminal(file=stream, highlight=False, markup=False, no_color=not self._colour)
        self._verbose = verbose
        self._now = now
        self._began = now()
        self._lock = threading.RLock()
        self._record = Record()
        self._columns = Columns()
        self._cached: list[NodeFinished] = []
        self._pending: list[Line] = []
        self._uploading: Uploading | None = None
        self._worked = False
        self._wake, self._stop = threading.Event(), threading.Event()
        self._live = Live(console=self._terminal, auto_refresh=False, transient=True, get_renderable=self._foot)
        self._thread = threading.Thread(target=self._draw, name="console", daemon=True)
        self._closed = False

    def __call__(self, event: Event) -> None:
        """Show one event, at the latest with the next tick."""
        if isinstance(event, RunFinished):
            self._record.follow(event)
            self.close()
            self._finish(event)
            return
        with self._lock:
            self._record.follow(event)
            self._take(event)
        if not self._closed and not self._thread.is_alive():
            self._thread.start()
        self._wake.set()

    def close(self) -> None:
        """Stop drawing, write what is held back, leave the terminal as it was."""
        if self._closed:
            return
        self._closed = True
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)
        with self._lock:
            self._record.running.clear()
            if self._worked:
                self._fold()
            self._print()
        self._live.stop()

    def _take(self, event: Event) -> None:
        is_cached = isinstance(event, NodeFinished) and event.status == "cached"
        self._worked |= isinstance(event, NodeStarted | RemoteGivenUp)
        self._worked |= isinstance(event, NodeFinished) and event.status in ("ran", "fetched", "failed")
        if isinstance(event, RunStarted):
            self._began = event.time
        if isinstance(event, Uploading):
            self._uploading = event
        elif isinstance(event, NodeFinished) and is_cached:
            self._cached.append(event)
        elif (line := self._columns.line(event, verbose=self._verbose)) is not None:
            self._fold()
            self._pending.append(line)

    def _fold(self) -> None:
        """Cached nodes in a row become lines, or one line where they are many."""
        self._pending += self._columns.several(self._cached)
        self._cached = []

    def _draw(self) -> None:
        patience = time.monotonic() + _PATIENCE_S
        while not self._stop.is_set():
            if self._wake.wait(_TICK_S):
                self._wake.clear()
                self._stop.wait(_DEBOUNCE_S)
            if self._stop.is_set() or not (self._worked or time.monotonic() > patience):
                continue
            self._live.start()
            with self._lock:
                self._print()
            self._live.refresh()

    def _print(self) -> None:
        if self._pending and self._worked:
            text = self._text(self._pending)
            self._pending = []
            self._terminal.print(text, no_wrap=True, overflow="ellipsis")

    def _foot(self) -> Text:
        with self._lock:
            running, now = list(self._record.running.values()), self._now()
            shown = foot(running, now, self._terminal.width, max(2, self._terminal.height // 2 - 2))
            if running or self._record.nodes:
                shown.append([(f"     {counted(self._record)}   {clock(now - self._began)}", "dim")])
        if self._uploading is not None:
            shown.append([("  ▸  ", "fetched"), *lines.uploading(self._uploading)])
        return self._text(shown)

    def _finish(self, event: RunFinished) -> None:
        for left in self._columns.left_over(self._record.left_over):
            self._terminal.print(self._text([left]))
        blocks = self._record.failures(colour=self._colour)
        for block in blocks:
            self._terminal.print()
            self._terminal.print(Text.from_ansi(block), soft_wrap=True)
        if self._worked or blocks:
            self._terminal.print()
        for closing in self._record.closing(event):
            self._terminal.print(self._text([closing]), soft_wrap=True)

    def _text(self, shown: list[Line]) -> Text:
        painted = "\n".join(lines.plain(line, colour=True) for line in shown)
        return Text.from_ansi(painted, no_wrap=True, overflow="ellipsis")
