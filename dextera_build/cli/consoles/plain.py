"""One line per finished node, and now and then one for a node that runs long: for logs, pipes and CI."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TextIO

from dextera_build.cli.consoles import Console, lines
from dextera_build.cli.consoles.foot import beat
from dextera_build.cli.consoles.lines import Columns, Line
from dextera_build.cli.consoles.record import Record
from dextera_build.cli.errors import wants_colour
from dextera_build.runs.events import Event, NodeFinished, NodeStarted, RemoteGivenUp, RunFinished, Uploading

_ASCII = str.maketrans({"↓": "v", "✗": "x", "·": ".", "…": "...", "–": "-", "×": "x", "→": "->", "°": " deg", "▸": ">"})
_BEAT_S = 30.0  # a log that says nothing for longer looks hung


class PlainConsole(Console):
    """Prints whole lines, each in one write.

    Lines are held back until something runs: where everything is cached, one line says so.

    Args:
        stream: Where to.
        verbose: Show the lines that nodes log, too.
        beat_s: A node that runs longer says how far it is, once in so many seconds.
        now: Seconds since the epoch.
    """

    def __init__(
        self, stream: TextIO, *, verbose: bool = False, beat_s: float = _BEAT_S, now: Callable[[], float] = time.time
    ) -> None:
        self._stream = stream
        self._verbose = verbose
        self._colour = wants_colour(stream)
        self._unicode = (getattr(stream, "encoding", None) or "utf-8").lower().replace("-", "").startswith("utf")
        self._lock = threading.Lock()
        self._columns = Columns()
        self._record = Record()
        self._held: list[Line] | None = []
        self._beat_s, self._now = beat_s, now
        self._uploading_at = 0.0
        self._stop = threading.Event()
        self._heart = threading.Thread(target=self._beat, name="console", daemon=True)

    def __call__(self, event: Event) -> None:
        """Show one event."""
        with self._lock:
            self._record.follow(event)
            if isinstance(event, RunFinished):
                self._record.running.clear()
                self._finish(event)
                return
            if isinstance(event, NodeStarted) and not (self._heart.is_alive() or self._stop.is_set()):
                self._heart.start()
            if isinstance(event, NodeStarted | RemoteGivenUp) or (
                isinstance(event, NodeFinished) and event.status != "cached"
            ):
                self._release()
            line = self._line(event)
            if line is not None and self._held is not None:
                self._held.append(line)
            elif line is not None:
                self._write(self._text(line))

    def close(self) -> None:
        """Write what is held back."""
        self._stop.set()
        with self._lock:
            self._release()
        if self._heart.is_alive():
            self._heart.join(timeout=2.0)

    def beat(self) -> None:
        """A line for each node that ran `beat_s` since it began or since its last line."""
        with self._lock:
            now = self._now()
            for node in self._record.running.values():
                if now - (node.told or node.started.time) >= self._beat_s:
                    node.told = now
                    self._write(self._text(beat(node, self._record, now)))

    def _beat(self) -> None:
        while not self._stop.wait(min(1.0, self._beat_s)):
            self.beat()

    def _line(self, event: Event) -> Line | None:
        if isinstance(event, Uploading) and event.time - self._uploading_at >= self._beat_s:
            self._uploading_at = event.time
            return lines.uploading(event)
        return self._columns.line(event, verbose=self._verbose)

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
        return lines.plain(line, colour=self._colour)

    def _write(self, text: str) -> None:
        if not self._unicode:
            text = text.translate(_ASCII)
        self._stream.write(text + "\n")
        self._stream.flush()
