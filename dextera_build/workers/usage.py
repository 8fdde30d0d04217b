"""What a node uses while it runs: processor time, memory, bytes read and written.

A worker measures itself and the children that it waited for. A number that the system does not give is left out.
"""

from __future__ import annotations

import resource
import time
from contextlib import suppress

Usage = dict[str, float]
"""`cpu_seconds`, `memory_bytes` (peak), `read_bytes` and `written_bytes` (by read and write calls, cached or not)."""


class Meter:
    """Measures one task in the process that runs it, from now on."""

    def __init__(self) -> None:
        with suppress(OSError), open("/proc/self/clear_refs", "wb") as peak:
            peak.write(b"5")  # the peak counts from here
        self._own, self._children, self._moved = time.process_time(), _children(), _moved()

    def end(self) -> Usage:
        """What the process used."""
        (before, record), (children, peak), moved = self._children, _children(), _moved()
        used: Usage = {"cpu_seconds": round(time.process_time() - self._own + children - before, 6)}
        if self._moved is not None and moved is not None:
            used["read_bytes"], used["written_bytes"] = moved[0] - self._moved[0], moved[1] - self._moved[1]
        # Of children only the largest of all times is known: it is this task's where that record was broken meanwhile.
        peak = max(_peak(), peak if peak > record else 0)
        if peak:
            used["memory_bytes"] = peak
        return used


def _children() -> tuple[float, int]:
    """Of all children that were waited for: processor time [s], and the peak of the largest [bytes]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def _peak() -> int:
    """Most that was resident since the last reset, or ever where that is not allowed [bytes]."""
    for line in _text("/proc/self/status").splitlines():
        if line.startswith(b"VmHWM:"):
            return int(line.split()[1]) * 1024
    return 0


def _moved() -> tuple[int, int] | None:
    """(read, written) so far [bytes]."""
    words = _text("/proc/self/io").split(None, 4)
    if len(words) < 4 or words[0] != b"rchar:" or words[2] != b"wchar:":
        return None
    return int(words[1]), int(words[3])


def _text(path: str) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError:
        return b""
