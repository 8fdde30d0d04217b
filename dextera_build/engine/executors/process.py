"""One worker process, seen from the pool: what it was given, what it says, and how it died."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import socket
import tempfile
import time
from typing import Any

from dextera_build import digest as digests
from dextera_build.engine.executors.nursery import Nursery
from dextera_build.engine.tasks import Task, printed
from dextera_build.errors import RuleError

_SPELL = digests.speller(ensure_ascii=True)
_TAIL_LINES = 12


class Process:
    """A running worker.

    It is the leader of its own process group, so that a Ctrl-C at the terminal does not reach it and that it can be
    ended with all that it started.

    It can be given a task before it is there.

    Args:
        nursery: What makes it.
        devices: GPUs that it may use.

    Raises:
        OSError: No more files can be opened.
    """

    def __init__(self, nursery: Nursery, devices: tuple[str, ...] = ()) -> None:
        self.nursery = nursery
        self.task: Task | None = None
        """What it was given and has not answered."""
        self.devices = devices
        self.began = 0.0
        self.peak = 0
        self.alive = True
        self._buffer = b""
        # Without a name, so that nothing is left behind however this ends.
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        # What is printed after the file was cut goes to its beginning.
        fcntl.fcntl(self._log.fileno(), fcntl.F_SETFL, os.O_APPEND)
        self._socket, theirs = socket.socketpair()
        self.pid = 0
        """0 until it is there."""
        self.refused = 0
        """The error number, where it cannot be made."""
        try:
            # CUDA looks at this once in a process, so a worker stays with its devices.
            environment = {"CUDA_VISIBLE_DEVICES": ",".join(devices)}
            nursery.make((theirs.fileno(), self._log.fileno()), environment, self._born)
        except OSError:
            self._socket.close()
            raise
        finally:
            theirs.close()

    def _born(self, pid: int) -> None:
        if pid < 0:
            self.refused = -pid
        elif self.alive:
            self.pid = pid

    @property
    def descriptor(self) -> int:
        """What becomes readable when the worker speaks; -1 when it has ended."""
        return self._socket.fileno()

    @property
    def has_ended(self) -> bool:
        """Whether the nursery said so; the socket need not, as something that it started may hold the other end."""
        return self.nursery.ended(self.pid) is not None

    def give(self, task: Task) -> None:
        """Give it a task; a worker that is dead already shows in `hear`."""
        self.task, self.began, self.peak = task, time.monotonic(), 0
        message = task.message()
        message["held"] = task.held
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._socket.sendall(b"%b\n%b\n" % (_SPELL(message).encode(), task.document))

    def hear(self) -> tuple[list[dict[str, Any]], bool]:
        """(what it said, whether it is dead)."""
        ended = self.has_ended
        with contextlib.suppress(BlockingIOError):
            while part := self._receive():
                self._buffer += part
            ended = True
        *lines, self._buffer = self._buffer.split(b"\n")
        return [json.loads(line) for line in lines], ended

    def _receive(self) -> bytes:
        """What has arrived, b"" at the end.

        Raises:
            BlockingIOError: Nothing has.
        """
        try:
            return self._socket.recv(1 << 16, socket.MSG_DONTWAIT)
        except ConnectionResetError:  # it died with a task unread
            return b""

    def is_running(self) -> bool:
        """Whether the process lives, or is being made."""
        self.nursery.hear()
        return not (self.refused or self.has_ended)

    def hang_up(self) -> None:
        """Close its end of the socket: the worker ends when it has nothing to do."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)

    def ask_to_end(self) -> None:
        """Ask it to clean up and end."""
        if self.pid and self.is_running():
            os.kill(self.pid, signal.SIGTERM)

    def end(self, patience_s: float) -> None:
        """Wait at most `patience_s` [s] for its end, then kill it; what it started is killed at once.

        One that is not there yet ends when it is, since it will have nothing to do.
        """
        self.hang_up()
        self.nursery.hear()
        if self.pid:
            self.nursery.wait(self.pid, patience_s)
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
            self.nursery.wait(self.pid, None)
            self.nursery.forget(self.pid)
        self.alive = False
        self._socket.close()

    def log(self) -> bytes:
        """What the node printed so far."""
        return printed(self._log.fileno())

    def death(self, log: bytes) -> RuleError:
        """What to say of a worker that died in the middle of a node."""
        code = self.nursery.ended(self.pid) or 0
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
