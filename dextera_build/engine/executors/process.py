"""One worker process, seen from the pool: two pipes, a log, and how it died."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dextera_build.engine.tasks import Task, printed
from dextera_build.errors import RuleError

_SPELL = json.JSONEncoder(separators=(",", ":")).encode
_MODULE = "dextera_build.engine.worker"
_ROOT = Path(__file__).resolve().parents[3]
_TAIL_LINES = 12


class Process:
    """A running worker.

    It is the leader of its own process group, so that a Ctrl-C at the terminal does not reach it and that it can be
    ended with all that it started.

    Args:
        runner: `module:function` for the worker.
        environment: Variables beside those of this process.
        path: Module search path for the worker.
        devices: GPUs that it may use; `environment` says so to the libraries.
    """

    def __init__(
        self, runner: str, environment: Mapping[str, str], path: Sequence[str], devices: tuple[str, ...] = ()
    ) -> None:
        self.task: Task | None = None
        self.devices = devices
        self.began = 0.0
        self.peak = 0
        self.alive = True
        self._buffer = b""
        # Without a name, so that nothing is left behind however this ends.
        self._log = tempfile.TemporaryFile(mode="a+b", buffering=0)  # noqa: SIM115
        reading, self._sending = os.pipe()
        self._hearing, writing = os.pipe()
        os.set_blocking(self._hearing, False)
        command = [sys.executable, "-m", _MODULE, runner, str(reading), str(writing), str(os.getpid())]
        try:
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                pass_fds=(reading, writing),
                start_new_session=True,
                env={**os.environ, **environment, "PYTHONPATH": _search_path()},
            )
        except OSError:
            os.close(self._sending)
            os.close(self._hearing)
            raise
        finally:
            os.close(reading)
            os.close(writing)
        self.pid = self._child.pid
        # The pipe alone does not tell: something that the worker started may hold its other end.
        self._watch = os.pidfd_open(self.pid) if hasattr(os, "pidfd_open") else -1
        self._write({"path": list(path)})

    def descriptors(self) -> list[int]:
        """What becomes readable when the worker speaks or dies."""
        return [descriptor for descriptor in (self._hearing, self._watch) if descriptor >= 0]

    def send(self, task: Task) -> None:
        """Give it a task; a worker that is dead already shows in `hear`."""
        self.began, self.peak = time.monotonic(), 0
        self._write(task.message() | {"document": len(task.document), "held": task.held}, task.document)

    def hear(self, descriptor: int) -> tuple[list[dict[str, Any]], bool]:
        """(what it said, whether it is dead), after one of `descriptors` became readable."""
        ended = descriptor == self._watch or (self._watch < 0 and not self.is_running())
        while True:
            try:
                part = os.read(self._hearing, 1 << 16)
            except BlockingIOError:
                break
            self._buffer += part
            if len(part) < 1 << 16:
                ended = ended or not part
                break
        *lines, self._buffer = self._buffer.split(b"\n")
        return [json.loads(line) for line in lines], ended

    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._child.poll() is None

    def hang_up(self) -> None:
        """Close the task pipe: the worker ends when it has nothing to do."""
        if self._sending >= 0:
            os.close(self._sending)
            self._sending = -1

    def ask_to_end(self) -> None:
        """Ask it to clean up and end."""
        self._child.send_signal(signal.SIGTERM)

    def end(self, patience_s: float) -> None:
        """Wait at most `patience_s` [s] for its end, then kill it; what it started is killed at once."""
        self.hang_up()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(patience_s)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        self._child.wait()
        self.alive = False
        for descriptor in self.descriptors():
            os.close(descriptor)
        self._hearing = self._watch = -1

    def log(self) -> bytes:
        """What the node printed so far."""
        return printed(self._log.fileno())

    def death(self, log: bytes) -> RuleError:
        """What to say of a worker that died in the middle of a node."""
        code = self._child.returncode
        if code < 0:
            try:
                name = signal.Signals(-code).name
            except ValueError:
                name = "unknown"
            reason, facts = f"signal {-code}", {"signal": f"{-code} ({name})"}
        else:
            reason, facts = f"exit code {code}", {"exit code": str(code)}
        tail = log.decode(errors="replace").strip().splitlines()[-_TAIL_LINES:]
        if tail:
            facts["log"] = "\n".join(tail)
        return RuleError(
            f"worker died ({reason})",
            code="DXB-B301",
            facts=facts,
            hint="build again, with `--jobs 1` where memory is short",
        )

    def _write(self, message: Mapping[str, object], more: bytes = b"") -> None:
        data = _SPELL(message).encode() + b"\n" + more
        with contextlib.suppress(BrokenPipeError):
            done = 0
            while done < len(data):
                done += os.write(self._sending, data[done:])


def _search_path() -> str:
    inherited = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), *([inherited] if inherited else [])])
