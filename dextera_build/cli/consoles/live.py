"""The build on a terminal: finished nodes scroll by, running nodes stand at the foot with a clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TextIO

from rich.ansi import AnsiDecoder
from rich.console import Console as Terminal
from rich.live import Live
from rich.style import Style
from rich.text import Text

from dextera_build.cli.consoles import Console, lines
from dextera_build.cli.consoles.foot import Running, clock, counted, foot
from dextera_build.cli.consoles.lines import Columns, Line
from dextera_build.cli.consoles.record import Record
from dextera_build.cli.errors import wants_colour
from dextera_build.runs.events import (
    BytesMissed,
    Event,
    GroupOpened,
    NodeFinished,
    NodeLog,
    NodeProgress,
    NodeRetried,
    NodeStarted,
    RemoteGivenUp,
    RunFinished,
    RunStarted,
    Uploading,
)

_DEBOUNCE_S = 0.05  # events within it are drawn together: ten thousand cached nodes must not draw ten thousand times
_TICK_S = 0.25  # a clock that stands still looks hung
_PATIENCE_S = 0.4  # a build that runs nothing and ends sooner shows its last line only

_RICH: dict[str, Style] = {
    "": Style(),
    "cached": Style(dim=True),
    "ran": Style(color="green"),
    "fetched": Style(color="cyan"),
    "failed": Style(color="red", bold=True),
    "waits": Style(color="yellow"),
    "cancelled": Style(color="yellow"),
    "name": Style(bold=True),
    "dim": Style(dim=True),
    "path": Style(color="cyan"),
}


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
        self._record = Record(counts=True)
        self._columns = Columns()
        self._running: dict[str, Running] = {}
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
            self._running.clear()
            if self._worked:
                self._fold()
            self._print()
        self._live.stop()

    def _take(self, event: Event) -> None:
        if isinstance(event, NodeStarted):
            self._worked = True
            self._running[event.node] = Running(event)
        elif isinstance(event, NodeProgress) and event.node in self._running:
            self._running[event.node].progress = event
        elif isinstance(event, NodeFinished):
            self._running.pop(event.node, None)
            if event.status == "cached":
                self._cached.append(event)
            elif event.status not in ("waits", "cancelled"):
                self._worked = True
                self._say(self._columns.node(event))
        elif isinstance(event, NodeRetried):
            self._running.pop(event.node, None)
            self._say(lines.retried(event))
        else:
            self._mention(event)

    def _mention(self, event: Event) -> None:
        if isinstance(event, RunStarted):
            self._began = event.time
            self._pending.append(lines.plan(event))
        elif isinstance(event, GroupOpened):
            self._say(lines.opened(event))
        elif isinstance(event, BytesMissed):
            self._say(lines.missed(event))
        elif isinstance(event, RemoteGivenUp):
            self._worked = True
            self._say(lines.given_up(event))
        elif isinstance(event, Uploading):
            self._uploading = event
        elif isinstance(event, NodeLog) and self._verbose:
            self._say(lines.logged(event.node, event.text))

    def _say(self, line: Line) -> None:
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
            text = Text("\n", no_wrap=True, overflow="ellipsis").join([_text(line) for line in self._pending])
            self._pending = []
            self._terminal.print(text, no_wrap=True, overflow="ellipsis")

    def _foot(self) -> Text:
        with self._lock:
            running = list(self._running.values())
            record, now = self._record, self._now()
        shown = foot(running, now, self._terminal.width, max(2, self._terminal.height // 2 - 2))
        if running or record.nodes:
            shown.append([(f"     {counted(record, len(running))}   {clock(now - self._began)}", "dim")])
        if self._uploading is not None:
            shown.append([("  ▸  ", "fetched"), *lines.uploading(self._uploading)])
        text = Text("\n", no_wrap=True, overflow="ellipsis").join([_text(line) for line in shown])
        text.no_wrap, text.overflow = True, "ellipsis"
        return text

    def _finish(self, event: RunFinished) -> None:
        for left in self._columns.left_over(self._record.left_over):
            self._terminal.print(_text(left))
        blocks = self._record.failures(colour=self._colour)
        for block in blocks:
            self._terminal.print()
            for line in AnsiDecoder().decode(block):
                self._terminal.print(line, soft_wrap=True)
        if self._worked or blocks:
            self._terminal.print()
        for closing in self._record.closing(event):
            self._terminal.print(_text(closing), soft_wrap=True)


def _text(line: Line) -> Text:
    text = Text(no_wrap=True, overflow="ellipsis")
    for piece, style in line:
        text.append(piece, _RICH[style])
    return text
