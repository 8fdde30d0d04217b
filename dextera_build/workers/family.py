"""The end of a worker with every process that it started, also of those in sessions of their own."""

from __future__ import annotations

import glob
import os
import signal
from contextlib import suppress

from dextera_build.outside import guard
from dextera_build.outside.marked import environment, marked

MARKER = "DEXTERA_WORKER"
"""Environment variable by which the processes that a worker started are known after its death."""
_PROGRAM = f"{guard.MARKER}=".encode()


def end(pid: int, mark: str) -> None:
    """Kill a worker and the processes that it started; the caller waits for the worker.

    Args:
        pid: The worker; its id is reserved, and it leads its process group.
        mark: Its value of `MARKER`.
    """
    with suppress(ProcessLookupError, PermissionError):
        os.kill(pid, signal.SIGSTOP)  # it starts no further process
    # The children of a dead worker may live on, as those of another process.
    is_alone = _is_alive(pid) and not any(map(_text, glob.iglob(f"/proc/{pid}/task/*/children")))
    found = [] if is_alone else strangers(guard.below(pid))
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)
    while found or not is_alone:
        guard.kill(found)
        found = strangers(marked(f"{MARKER}={mark}"))
        is_alone = not found


def strangers(pids: list[int]) -> list[int]:
    """Those of some processes that belong to no program of a backend: guards end these, and clean up."""
    return [pid for pid in pids if not any(said.startswith(_PROGRAM) for said in environment(pid))]


def _is_alive(pid: int) -> bool:
    return _text(f"/proc/{pid}/stat").rpartition(b")")[2].split()[:1] not in ([], [b"Z"], [b"X"])


def _text(file: str) -> bytes:
    with suppress(OSError), open(file, "rb") as opened:
        return opened.read()
    return b""
