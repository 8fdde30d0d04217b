"""One worker process, seen from the pool: what it was given, what it says, and how it died.

Tasks go through a socket that keeps messages apart, and the pool holds both of its ends: so it can take back what the
worker has not taken yet, and the system sees to it that each task is taken once.
"""

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
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dextera_build import digest as digests
from dextera_build.engine.tasks import PACKET, Task, printed
from dextera_build.errors import RuleError
from dextera_build.store.files import write_all

_SPELL = digests.speller(ensure_ascii=True)
_READ = json.JSONDecoder().decode
_MODULE = "dextera_build.engine.worker"
_ROOT = Path(__file__).resolve().parents[3]
_TAIL_LINES = 12
_NAME = 32
"""No ticket takes more [bytes]."""


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
        self.tasks: deque[Task] = deque()
        """What it was given and has not answered; the first is the one that it has, the others stand behind."""
        self.answered = 0
        """How many tasks it has answered."""
        self._sent = 0
        """How many of `tasks` lie in the socket or are with the worker."""
        self.devices = devices
        self.began = 0.0
        self.peak = 0
        self.alive = True
        self._buffer = b""
        # Without a name, so that nothing is left behind however this ends.
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        # What is printed after the file was cut goes to its beginning.
        fcntl.fcntl(self._log.fileno(), fcntl.F_SETFL, os.O_APPEND)
        self._sending, self._taking = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._sending.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * PACKET)
        # What the worker is told once, and behind that a task that is too large for the socket.
        self._large = os.memfd_create("task")
        self._told = os.write(self._large, _SPELL({"path": list(path)}).encode() + b"\n")
        self._hearing, writing = os.pipe()
        os.set_blocking(self._hearing, False)
        passed = (self._taking.fileno(), self._large, writing)
        command = [sys.executable, "-m", _MODULE, runner, *map(str, passed), str(os.getpid())]
        try:
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                pass_fds=passed,
                start_new_session=True,
                env={**os.environ, **environment, "PYTHONPATH": _search_path()},
            )
        except OSError:
            self.hang_up()
            os.close(self._hearing)
            raise
        finally:
            os.close(writing)
        self.pid = self._child.pid
        # The pipe alone does not tell: something that the worker started may hold its other end.
        self._watch = os.pidfd_open(self.pid) if hasattr(os, "pidfd_open") else -1

    def descriptors(self) -> list[int]:
        """What becomes readable when the worker speaks or dies."""
        return [descriptor for descriptor in (self._hearing, self._watch) if descriptor >= 0]

    def give(self, task: Task) -> None:
        """Give it a task, behind those that it has; a worker that is dead already shows in `hear`."""
        self.tasks.append(task)
        if len(self.tasks) == 1:
            self._begin()
        self._send()

    def advance(self) -> Task:
        """It has answered its first task, and begins the next."""
        task = self.tasks.popleft()
        self.answered, self._sent = self.answered + 1, self._sent - 1
        self._begin()
        self._send()
        return task

    def take_back(self) -> list[Task]:
        """Take back all tasks that it has not begun, the first as well where it has not.

        It goes on meanwhile, so what it has begun may have stood behind one that is taken back.
        """
        tickets = self._taken_back()
        begun = [task for task in list(self.tasks)[: self._sent] if task.ticket not in tickets]
        back = [task for task in self.tasks if task not in begun]
        self.tasks, self._sent = deque(begun), len(begun)
        return back

    def _begin(self) -> None:
        self.began, self.peak = time.monotonic(), 0

    def _send(self) -> None:
        """Put into the socket what it has room for."""
        while self._sent < len(self.tasks):
            packet = self._packet(self.tasks[self._sent])
            if packet is None:
                return
            try:
                self._sending.send(packet, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            self._sent += 1

    def _packet(self, task: Task) -> bytes | None:
        """What stands for a task in the socket; None for a large one whose turn has not come."""
        name = b"%d\n" % task.ticket
        message = task.message()
        message["held"] = task.held
        data = b"%b\n%b" % (_SPELL(message).encode(), task.document)
        if len(name) + len(data) <= PACKET:
            return name + data
        if self._sent:
            return None
        os.ftruncate(self._large, self._told)
        os.lseek(self._large, self._told, os.SEEK_SET)
        write_all(self._large, data)
        return name + b"@%d %d" % (self._told, len(data))

    def _taken_back(self) -> set[int]:
        """Tickets of the tasks that were taken out of the socket."""
        tickets = set()
        with contextlib.suppress(BlockingIOError):
            while packet := self._taking.recv(_NAME, socket.MSG_DONTWAIT):
                tickets.add(int(packet.partition(b"\n")[0]))
        return tickets

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
        return [_READ(line.decode()) for line in lines], ended

    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._child.poll() is None

    def hang_up(self) -> None:
        """Close the socket: the worker ends when it has nothing to do."""
        self._sending.close()
        self._taking.close()
        if self._large >= 0:
            os.close(self._large)
            self._large = -1

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


def _search_path() -> str:
    inherited = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), *([inherited] if inherited else [])])
