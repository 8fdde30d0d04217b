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
import tempfile
import time
from collections import deque
from typing import Any

from dextera_build import digest as digests
from dextera_build.engine.executors.nursery import Nursery
from dextera_build.engine.tasks import PACKET, Task, printed
from dextera_build.errors import RuleError
from dextera_build.store.files import write_all

_SPELL = digests.speller(ensure_ascii=True)
_READ = json.JSONDecoder().decode
_TAIL_LINES = 12
_NAME = 32
"""No ticket takes more [bytes]."""


class Process:
    """A running worker.

    It is the leader of its own process group, so that a Ctrl-C at the terminal does not reach it and that it can be
    ended with all that it started.

    It can be given tasks before it is there.

    Args:
        nursery: What makes it.
        devices: GPUs that it may use.

    Raises:
        OSError: No more files can be opened.
    """

    def __init__(self, nursery: Nursery, devices: tuple[str, ...] = ()) -> None:
        self.nursery = nursery
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
        # For a task that is too large for the socket.
        self._large = os.memfd_create("task")
        self._hearing, writing = os.pipe()
        os.set_blocking(self._hearing, False)
        self.pid = 0
        """0 until it is there."""
        self.refused = 0
        """The error number, where it cannot be made."""
        try:
            # CUDA looks at this once in a process, so a worker stays with its devices.
            environment = {"CUDA_VISIBLE_DEVICES": ",".join(devices)}
            passed = (self._taking.fileno(), self._large, writing, self._log.fileno())
            nursery.make(passed, environment, self._born)
        except OSError:
            self.hang_up()
            os.close(self._hearing)
            raise
        finally:
            os.close(writing)

    def _born(self, pid: int) -> None:
        if pid < 0:
            self.refused = -pid
        elif self.alive:
            self.pid = pid

    @property
    def descriptor(self) -> int:
        """What becomes readable when the worker speaks; -1 when it has ended."""
        return self._hearing

    @property
    def has_ended(self) -> bool:
        """Whether the nursery said so; the pipe need not, as something that it started may hold the other end."""
        return self.nursery.ended(self.pid) is not None

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
        os.ftruncate(self._large, 0)
        os.lseek(self._large, 0, os.SEEK_SET)
        write_all(self._large, data)
        return name + b"@%d" % len(data)

    def _taken_back(self) -> set[int]:
        """Tickets of the tasks that were taken out of the socket."""
        tickets = set()
        with contextlib.suppress(BlockingIOError):
            while packet := self._taking.recv(_NAME, socket.MSG_DONTWAIT):
                tickets.add(int(packet.partition(b"\n")[0]))
        return tickets

    def hear(self) -> tuple[list[dict[str, Any]], bool]:
        """(what it said, whether it is dead)."""
        ended = self.has_ended
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
        """Whether the process lives, or is being made."""
        self.nursery.hear()
        return not (self.refused or self.has_ended)

    def hang_up(self) -> None:
        """Close the socket: the worker ends when it has nothing to do."""
        self._sending.close()
        self._taking.close()
        if self._large >= 0:
            os.close(self._large)
            self._large = -1

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
        os.close(self._hearing)
        self._hearing = -1

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
