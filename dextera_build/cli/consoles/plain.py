"""One line per finished node, and periodic lines for long-running nodes: for logs, pipes and CI."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import TextIO

from dextera_build.cli.consoles import Console, lines
from dextera_build.cli.consoles.lines import Line
from dextera_build.cli.consoles.record import beat
from dextera_build.runs.events import (
    BytesMissed,
    Event,
    NodeFinished,
    NodeStarted,
    RemoteGivenUp,
    RunFinished,
    RunStarted,
)

_ASCII = str.maketrans({"↓": "v", "✗": "x", "·": ".", "…": "...", "–": "-", "×": "x", "→": "->", "°": " deg", "▸": ">"})
_BEAT_S = 30.0  # a log that is silent for longer looks hung


class PlainConsole(Console):
    """Prints whole lines, each in one write.

    Lines are held back until something runs; if everything is cached, one line says so.

    Args:
        stream: The output.
        verbose: Also show the lines that nodes log.
        beat_s: Interval between progress lines of a running node [s].
        now: Seconds since the epoch.
    """

    TICK_S = 1.0
    """Interval at which the thread checks running nodes [s]."""

    def __init__(
        self, stream: TextIO, *, verbose: bool = False, beat_s: float = _BEAT_S, now: Callable[[], float] = time.time
    ) -> None:
        super().__init__(stream)
        self._verbose, self._beat_s, self._now = verbose, beat_s, now
        self._unicode = (getattr(stream, "encoding", None) or "utf-8").lower().replace("-", "").startswith("utf")
        self._held: list[Line] | None = []
        self._uploads_told = 0.0
        self._fetched: set[str] = set()
        """Nodes with a line that says they were fetched."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="console", daemon=True)

    def close(self) -> None:
        """Write the lines held back."""
        self._end()
        with self._lock:
            self._release()

    def tick(self) -> None:
        """Write a progress line for each node that has run `beat_s` since its start or last line, and for uploads."""
        with self._lock:
            now = self._now()
            for node in self.record.running.values():
                if now - (node.told or node.started.time) >= self._beat_s:
                    node.told = now
                    self._write([beat(node, self.record, now)])
            if self.record.uploading is not None and now - self._uploads_told >= self._beat_s:
                self._uploads_told = now
                self._write([lines.uploading(self.record.uploading)])

    def _show(self, event: Event) -> None:
        if isinstance(event, RunFinished):
            self._end()
        with self._lock:
            self.record.follow(event)
            if isinstance(event, RunFinished):
                self._finish(event)
                return
            if not (self._thread.is_alive() or self._stop.is_set()):
                self._thread.start()
            ran = isinstance(event, NodeFinished) and event.status != "cached"
            if ran or isinstance(event, NodeStarted | RemoteGivenUp):
                self._release()
            line = None if self._is_told(event) else lines.line(event, verbose=self._verbose)
            if line is not None and self._held is not None:
                self._held.append(line)
            elif line is not None:
                self._write([line])

    def _is_told(self, event: Event) -> bool:
        """Whether an event is about the bytes of a node whose fetched result has its line: one node, one line."""
        if isinstance(event, RunStarted):
            self._fetched.clear()
        if isinstance(event, NodeFinished) and event.status == "fetched":
            told = event.node in self._fetched
            self._fetched.add(event.node)
            return told
        return isinstance(event, BytesMissed) and event.node in self._fetched

    def _run(self) -> None:
        while not self._stop.wait(min(self.TICK_S, self._beat_s)):
            self.tick()

    def _end(self) -> None:
        """Stop the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=2.0)

    def _finish(self, event: RunFinished) -> None:
        closing = self.record.closing(event)
        if self._held is not None and event.ok:
            self._held = None
        else:
            self._release()
            self._write(lines.left_over(self.record.left_over))
            for block in self.record.failures(colour=self._colour):
                self._print("\n" + block)
            closing = [[], *closing]
        self._write(closing)

    def _release(self) -> None:
        held, self._held = self._held or [], None
        self._write(held)

    def _write(self, shown: Sequence[Line]) -> None:
        if shown:
            self._print("\n".join(lines.plain(line, colour=self._colour) for line in shown))

    def _print(self, text: str) -> None:
        """Write whole lines at once."""
        self._stream.write((text if self._unicode else text.translate(_ASCII)) + "\n")
        self._stream.flush()
