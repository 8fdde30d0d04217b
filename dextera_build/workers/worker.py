"""A worker process: takes tasks one at a time, passes each to the runner, and answers with JSON lines.

    python -m dextera_build.workers.worker <module:function> <descriptor of a socket> <process id>

Standard output and error belong to the running node; the pool provides a file for them and reads it when a worker has
died. The first line on the socket is the pool's module search path, each further line a task. The runner's reply is
passed on, with the state that the task leaves in the process: the worker does not publish results. It exits when the
socket closes or its parent dies.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import importlib
import io
import json
import os
import re
import resource
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.errors import DxbError, MachineError
from dextera_build.redact import redact_plain
from dextera_build.workers.protocol import escaped, printed, redacted_reply
from dextera_build.workers.retries import names_of

if TYPE_CHECKING:
    from dextera_build.workers.leftovers import Leftovers

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_PROGRESS_S = 0.05
"""Minimum interval between progress messages [s]."""


class Worker:
    """Serves tasks until the socket closes.

    Args:
        runner: `module:function`.
        pool: Socket connected to the pool.
    """

    def __init__(self, runner: str, pool: socket.socket) -> None:
        self._named = runner
        self._pool = pool
        self._writing = threading.Lock()
        self._last_progress = 0.0
        self._libc = ctypes.CDLL(None)

    def serve(self) -> None:
        """Answer tasks, one at a time."""
        with self._pool.makefile("rb") as told:
            # The same search path in the same order, so that imports find the same modules as in the pool's process.
            sys.path[:] = json.loads(told.readline() or "null") or sys.path
            try:
                runner = load(self._named)
            except Exception as error:
                runner = _refusing(error)
            from dextera_build.workers.leftovers import Leftovers  # the pool needs nothing of it

            leftovers = Leftovers()
            self._write({"ready": True})
            for line in told:
                self._answer(runner, json.loads(line), leftovers)

    def _answer(self, runner: Callable[..., Mapping[str, Any]], task: Mapping[str, Any], leftovers: Leftovers) -> None:
        if os.fstat(1).st_size:
            os.ftruncate(1, 0)
        self._last_progress = 0.0
        answer = leftovers.apart(lambda: attempt(lambda: runner(task, self._emit), task["project"]))
        try:
            answer["leaves"] = leftovers.clear()
        except Exception as error:  # it may call functions that the task replaced
            answer["leaves"] = str(error) or type(error).__name__
        self._flush()
        answer["reply"] = redacted_reply(answer["reply"])
        answer["error"] = answer["error"] and answer["error"].to_json()
        answer["log"] = redact_plain(printed(1)).decode("latin-1")  # any bytes; the next task overwrites them
        self._write(answer)

    def _emit(self, kind: str, data: Mapping[str, Any]) -> None:
        data = redact_plain(dict(data))
        if kind == "progress":
            now = time.monotonic()
            if now - self._last_progress < _PROGRESS_S and data.get("done") != data.get("total"):
                return
            self._last_progress = now
        elif kind == "log":
            print(data.get("text", ""))
        self._write({"said": [kind, dict(data)]})

    def _flush(self) -> None:
        # Buffered output of C libraries would otherwise appear in the log of a later node.
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        self._libc.fflush(None)

    def _write(self, answer: Mapping[str, object]) -> None:
        with self._writing:
            self._pool.sendall(json.dumps(answer, default=str).encode() + b"\n")


def attempt(call: Callable[[], Mapping[str, Any]], project: str) -> dict[str, Any]:
    """Execute a call in this process; returns the fields of an `Ended`, without the log.

    Args:
        call: Returns the reply.
        project: The project folder, see `escaped`.
    """
    reply: Mapping[str, Any] | None = None
    error: DxbError | None = None
    raised: list[str] = []
    meter, began = Meter(), time.perf_counter()
    try:
        reply = dict(call())
    except DxbError as known:
        error = known
    except Exception as unknown:
        with contextlib.suppress(OSError):  # if the log's disk is full, the error is still reported
            traceback.print_exc()
        error, raised = escaped(unknown, project), names_of(unknown)
    seconds = time.perf_counter() - began
    return {"reply": reply, "error": error, "raised": raised, "seconds": seconds, "usage": meter.end()}


class Meter:
    """Measures one task in the process that runs it, starting on creation."""

    def __init__(self) -> None:
        with contextlib.suppress(OSError), open("/proc/self/clear_refs", "wb") as peak:
            peak.write(b"5")  # the peak counts from here
        self._own, self._children, self._moved = time.process_time(), _children(), _numbers("io")

    def end(self) -> dict[str, float]:
        """Resources used by the process and by children it waited for; see `Ended.usage`."""
        (before, record), (children, peak), moved = self._children, _children(), _numbers("io")
        used: dict[str, float] = {"cpu_seconds": round(time.process_time() - self._own + children - before, 6)}
        if self._moved and moved:
            used["read_bytes"] = moved["rchar"] - self._moved["rchar"]
            used["written_bytes"] = moved["wchar"] - self._moved["wchar"]
        # Only the all-time peak of children is known; it counts for this task if it rose during the task.
        peak = max(_numbers("status").get("VmHWM", 0) * 1024, peak if peak > record else 0)
        if peak:
            used["memory_bytes"] = peak
        return used


def _children() -> tuple[float, int]:
    """CPU time of all children that were waited for [s], and the largest peak memory among them [bytes]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def _numbers(table: str) -> dict[str, int]:
    """Numbers in a `/proc` table of this process; empty if it cannot be read."""
    with contextlib.suppress(OSError), open(f"/proc/self/{table}") as rows:
        return {name: int(number) for name, number in re.findall(r"^(\w+):\s*(\d+)", rows.read(), re.MULTILINE)}
    return {}


def load(named: str) -> Callable[..., Any]:
    """The function that `module:function` names."""
    module, _, name = named.partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return found


def _refusing(error: Exception) -> Callable[..., Mapping[str, Any]]:
    """A runner that fails every task, used if the real one cannot be loaded."""

    def run(task: Mapping[str, Any], emit: object) -> Mapping[str, Any]:
        traceback.print_exception(error)
        said = f"{type(error).__name__}: {error}"
        raise MachineError(f"a worker cannot start: {said}", code="DXB-E201", hint="dxb doctor")

    return run


def live_with(parent: int) -> None:
    """Exit when the parent process, with this id, exits."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        # What leaves its parent stays a child of this process, which is looked at after each task.
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    if os.getppid() != parent:  # it died before the signal was set up
        os._exit(1)


def main(arguments: list[str]) -> None:
    """Entry point; see the module docstring."""
    runner, descriptor, parent = arguments[0], *map(int, arguments[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    live_with(parent)
    os.set_inheritable(descriptor, False)
    faulthandler.enable()
    # Line-buffered, so that the output of a worker that dies is complete.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    with contextlib.suppress(ConnectionError, SystemExit):
        Worker(runner, socket.socket(fileno=descriptor)).serve()
    # Lingering threads and libraries must not keep an idle worker alive.
    os._exit(0)


def _leave(number: int, frame: object) -> None:
    # Raise instead of exiting at once, so that the node's scratch folder is removed.
    raise SystemExit(128 + number)


if __name__ == "__main__":
    main(sys.argv[1:])
