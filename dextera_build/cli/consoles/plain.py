"""One line per finished node, for logs, pipes and CI."""

from __future__ import annotations

import threading
from types import TracebackType
from typing import Self, TextIO

from dextera_build.cli.consoles import lines
from dextera_build.cli.consoles.lines import STYLES, Columns, Line
from dextera_build.cli.consoles.record import Record
from dextera_build.cli.errors import paint, wants_colour
from dextera_build.engine.events import Event, GroupOpened, NodeFinished, NodeLog, NodeStarted, RunFinished, RunStarted

_ASCII = str.maketrans({"↓": "v", "✗": "x", "·": ".", "…": "...", "–": "-", "×": "x", "→": "->", "°": " deg"})


class PlainConsole:
    """Prints whole lines, each in one write.

    Lines are held back until something runs: where everything is cached, one line says so.
    """

    def __init__(self, stream: TextIO, *, verbose: bool = False) -> None:
        self._stream = stream
        self._verbose = verbose
        self._colour = wants_colour(stream)
        self._unicode = (getattr(stream, "encoding", None) or "utf-8").lower().replace("-", "").startswith("utf")
        self._lock = threading.Lock()
        self._columns = Columns()
        self._record = Record()
        self._held: list[Line] | None = []

    def __call__(self, event: Event) -> None:
        """Show one event."""
        with self._lock:
            self._record.follow(event)
            if isinstance(event, RunFinished):
                self._finish(event)
                return
            if isinstance(event, NodeStarted) or (isinstance(event, NodeFinished) and event.status != "cached"):
                self._release()
            line = self._line(event)
            if line is not None and self._held is not None:
                self._held.append(line)
            elif line is not None:
                self._write(self._text(line))

    def close(self) -> None:
        """Write what is held back."""
        with self._lock:
            self._release()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _line(self, event: Event) -> Line | None:
        if isinstance(event, RunStarted):
            return lines.plan(event)
        if isinstance(event, GroupOpened):
            return lines.opened(event)
        if isinstance(event, NodeFinished) and event.status not in ("waits", "cancelled"):
            return self._columns.node(event)
        if isinstance(event, NodeLog) and self._verbose:
            return lines.logged(event.node, event.text)
        return None

    def _finish(self, event: RunFinished) -> None:
        closing = [self._text(line) for line in self._record.closing(event)]
        if self._held is not None and event.ok:
            self._held = None
            self._write("\n".join(closing))
            return
        self._release()
        for line in self._columns.left_over(self._record.left_over):
            self._write(self._text(line))
        for block in self._record.failures(colour=self._colour):
            self._write("\n" + block)
        self._write("\n" + "\n".join(closing))

    def _release(self) -> None:
        held, self._held = self._held or [], None
        if held:
            self._write("\n".join(self._text(line) for line in held))

    def _text(self, line: Line) -> str:
        return "".join(paint(text, STYLES[style], self._colour and bool(STYLES[style])) for text, style in line)

    def _write(self, text: str) -> None:
        if not self._unicode:
            text = text.translate(_ASCII)
        self._stream.write(text + "\n")
        self._stream.flush()
