"""What a node uses while it runs: processor time, memory, bytes read and written.

The worker measures itself and the children that it waited for; the pool looks at the whole tree of processes from
outside a few times a second, which also tells how large a worker was that died. A number that the system does not give
is left out.
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Mapping
from contextlib import suppress

Usage = dict[str, float]
"""`cpu_seconds`, `memory_bytes` (peak), `read_bytes` and `written_bytes` (by read and write calls, cached or not)."""

_PAGE = os.sysconf("SC_PAGE_SIZE")


class Meter:
    """Measures one task after another in the process that runs them."""

    def __init__(self) -> None:
        self._own = 0.0
        """Processor time of this process when the task began [s], and the next two likewise."""
        self._children = (0.0, 0)
        self._moved: tuple[int, int] | None = None

    def begin(self) -> None:
        """A task begins."""
        with suppress(OSError), open("/proc/self/clear_refs", "wb") as peak:
            peak.write(b"5")  # the peak counts from here
        self._own, self._children, self._moved = time.process_time(), _children(), _moved()

    def end(self) -> Usage:
        """What the process used since `begin`."""
        (before, record), (children, peak), moved = self._children, _children(), _moved()
        used: Usage = {"cpu_seconds": round(time.process_time() - self._own + children - before, 6)}
        if self._moved is not None and moved is not None:
            used["read_bytes"], used["written_bytes"] = moved[0] - self._moved[0], moved[1] - self._moved[1]
        # Of children only the largest of all times is known: it is this task's where that record was broken meanwhile.
        peak = max(_peak(), peak if peak > record else 0)
        if peak:
            used["memory_bytes"] = peak
        return used


def with_peak(usage: Mapping[str, float], seen: int) -> Usage:
    """What a worker said of itself, and the most that its tree was seen with from outside [bytes]."""
    peak = max(usage.get("memory_bytes", 0), seen)
    return {**usage, "memory_bytes": peak} if peak else dict(usage)


def tree_bytes(root: int) -> int:
    """Resident memory of a process and all that descends from it; pages that they share count for each [bytes]."""
    total, stack = 0, [root]
    while stack:
        pid = stack.pop()
        with suppress(OSError, ValueError, IndexError):
            with open(f"/proc/{pid}/statm") as file:
                total += int(file.read().split()[1]) * _PAGE
            for thread in os.listdir(f"/proc/{pid}/task"):
                with open(f"/proc/{pid}/task/{thread}/children") as file:
                    stack += [int(child) for child in file.read().split()]
    return total


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
