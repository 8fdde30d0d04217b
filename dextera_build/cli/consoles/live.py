"""The live console: finished nodes scroll by, running nodes are listed in a footer with a clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

from rich.console import Console as Terminal
from rich.live import Live
from rich.text import Text

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.plain import PlainConsole
from dextera_build.cli.consoles.record import clock, counted, foot

_PATIENCE_S = 0.4  # a shorter build that runs nothing shows its last line only


class LiveConsole(PlainConsole):
    """The log of a plain console above a footer.

    A thread draws both at a fixed rate: a busy engine does not stop the clocks, and ten thousand nodes do not cause
    ten thousand redraws.
    """

    TICK_S = 0.1

    def __init__(
        self,
        stream: TextIO,
        *,
        verbose: bool = False,
        now: Callable[[], float] = time.time,
        terminal: Terminal | None = None,
    ) -> None:
        super().__init__(stream, verbose=verbose, now=now)
        self._terminal = terminal or Terminal(file=stream, highlight=False, markup=False, no_color=not self._colour)
        self._began = now()
        self._pending: list[str] = []
        self._live = Live(console=self._terminal, auto_refresh=False, transient=True, get_renderable=self._foot)

    def tick(self) -> None:
        """Draw the log and the footer."""
        with self._lock:
            if self._held is None or self._now() - self._began > _PATIENCE_S:
                self._live.start()
            self._flush()
            self._live.refresh()

    def _end(self) -> None:
        super()._end()
        with self._lock:
            self.record.running.clear()
            self._flush()
            self._live.stop()

    def _print(self, text: str) -> None:
        self._pending.append(text)
        if self._stop.is_set():
            self._flush()

    def _flush(self) -> None:
        if self._pending:
            self._terminal.print(_text("\n".join(self._pending)), no_wrap=True, overflow="ellipsis")
            self._pending = []

    def _foot(self) -> Text:
        with self._lock:
            running, now = list(self.record.running.values()), self._now()
            shown = foot(running, now, self._terminal.width, max(2, self._terminal.height // 2 - 2))
            if running or self.record.nodes:
                shown.append([(f"     {counted(self.record)}   {clock(now - self._began)}", "dim")])
            if self.record.uploading is not None:
                shown.append([("  ▸  ", "fetched"), *lines.uploading(self.record.uploading)])
        return _text("\n".join(lines.plain(line, colour=True) for line in shown))


def _text(painted: str) -> Text:
    return Text.from_ansi(painted, no_wrap=True, overflow="ellipsis")
