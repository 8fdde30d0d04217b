"""One worker process, seen from the pool: what it was given, what it says, and how it died."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dextera_build.errors import RuleError
from dextera_build.workers import worker
from dextera_build.workers.protocol import Task, printed

_TAIL_LINES = 12
_ROOT = Path(__file__).resolve().parents[2]
"""Where this package lies."""
_LOOK_S = 0.001


class Process:
    """A running worker: an interpreter of its own, which shares nothing with this process but the module search path.

    It leads a session and a process group of its own, so that a Ctrl-C at the terminal does not reach it and that it
    can be ended with everything that it started. It can be given a task while it is still loading.

    Args:
        runner: `module:function` that carries out a task.
        environment: Variables beside those of this process.
        devices: GPUs that it may use.

    Raises:
        OSError: No process can be started, or no file opened.
    """

    def __init__(self, runner: str, environment: Mapping[str, str], devices: tuple[str, ...] = ()) -> None:
        self.task: Task | None = None
        """What it was given and has not answered."""
        self.devices = devices
        self.is_ready = False
        """Whether it has loaded what it runs tasks with."""
        self.began = time.monotonic()
        """When its task began, or it began to load, by `time.monotonic`."""
        self.peak = 0
        """Most memory that it and its children had, once it was ended [bytes]."""
        self._buffer = b""
        # Without a name, so that nothing is left behind however this ends.
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        # What is printed after the file was cut goes to its beginning.
        fcntl.fcntl(self._log.fileno(), fcntl.F_SETFL, os.O_APPEND)
        self._socket, theirs = socket.socketpair()
        with theirs:
            try:
                self._child = subprocess.Popen(
                    [sys.executable, "-P", "-m", worker.__name__, runner, str(theirs.fileno()), str(os.getpid())],
                    stdin=subprocess.DEVNULL,
                    stdout=self._log,
                    stderr=self._log,
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,
                    # CUDA looks at its variable once in a process, so a worker stays with its devices.
                    env={
                        **os.environ,
                        **environment,
                        "CUDA_VISIBLE_DEVICES": ",".join(devices),
                        "PYTHONPATH": _search_path(),
                    },
                )
            except OSError:
                self._socket.close()
                raise
        self._send(json.dumps([entry or os.getcwd() for entry in sys.path]).encode())

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._child.pid

    @property
    def descriptor(self) -> int:
        """What becomes readable when the worker speaks or ends; -1 when it was ended."""
        return self._socket.fileno()

    @property
    def has_ended(self) -> bool:
        """Whether it is dead; the socket need not say so, as something that it started may hold the other end."""
        try:
            # Its process id stays its own until `end` has killed its group.
            return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        except ChildProcessError:  # the program around the build does not want to know of its children
            return True

    def give(self, task: Task) -> None:
        """Give it a task; a worker that is dead already shows in `hear`."""
        self.task, self.began = task, time.monotonic()
        self._send(json.dumps(task.message()).encode())

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._socket.sendall(data + b"\n")

    def hear(self) -> tuple[list[dict[str, Any]], bool]:
        """(what it said, whether it is dead)."""
        ended = self.has_ended
        with contextlib.suppress(BlockingIOError, ConnectionResetError):  # a reset: it died with a task unread
            while part := self._socket.recv(1 << 16, socket.MSG_DONTWAIT):
                self._buffer += part
            ended = True
        *lines, self._buffer = self._buffer.split(b"\n")
        return [json.loads(line) for line in lines], ended

    def ask_to_end(self) -> None:
        """Ask it to clean up and end."""
        if not self.has_ended:
            os.kill(self.pid, signal.SIGTERM)

    def end(self, patience_s: float) -> None:
        """Wait at most `patience_s` [s] for its end, then kill it; what it started is killed at once."""
        deadline = time.monotonic() + patience_s
        while not self.has_ended and time.monotonic() < deadline:
            time.sleep(_LOOK_S)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        try:
            _, status, used = os.wait4(self.pid, 0)
            self._child.returncode, self.peak = os.waitstatus_to_exitcode(status), used.ru_maxrss * 1024
        except ChildProcessError:  # the program around the build does not want to know of its children
            self._child.returncode = 0
        self._socket.close()

    def log(self) -> bytes:
        """What the node printed so far."""
        return printed(self._log.fileno())

    def death(self, log: bytes) -> RuleError:
        """What to say of a worker that died in the middle of a node, once it was ended."""
        code = self._child.returncode
        if code < 0:
            try:
                name = signal.Signals(-code).name
            except ValueError:
                name = "unknown"
            reason, facts = f"signal {-code}", {"signal": f"{-code} ({name})"}
        else:
            reason, facts = f"exit code {code}", {"exit code": str(code)}
        tail = log.decode(errors="replace").strip().splitlines()
        # Where Python says where it was, the innermost call stands first.
        fatal = next((place for place, line in enumerate(tail) if line.startswith("Fatal Python error")), None)
        tail = tail[-_TAIL_LINES:] if fatal is None else tail[fatal : fatal + _TAIL_LINES]
        if tail:
            facts["log"] = "\n".join(tail)
        return RuleError(
            f"worker died ({reason})",
            code="DXB-B301",
            facts=facts,
            hint="build again, with `--jobs 1` where memory is short",
        )


def _search_path() -> str:
    inherited = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), *([inherited] if inherited else [])])
