"""The process that makes workers, seen from the pool; see `engine.nursery`."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from dextera_build.engine import nursery
from dextera_build.engine.nursery import MESSAGE, ROOT
from dextera_build.engine.tasks import printed

_GRACE_S = 1.0


class Nursery:
    """A running nursery, which loads nothing before it is told what.

    Args:
        forked: Whether it is a fork of this process, which has one thread and has opened and begun nothing: then it
            need not load what is loaded here.

    Raises:
        OSError: No process can be started.
    """

    def __init__(self, *, forked: bool = False) -> None:
        self._asked: deque[Callable[[int], None]] = deque()
        """Who asked for a worker and has none yet."""
        self._codes: dict[int, int] = {}
        """Exit codes of workers that have ended."""
        self._code: int | None = None
        self.has_news = False
        """Whether `hear` took in something that the pool has not looked at."""
        self._has_answered = False
        self._told: dict[str, str] | None = None
        """Variables that it knows of."""
        # Without a name, so that nothing is left behind however this ends.
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._control.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MESSAGE)
        try:
            forks = forked and min(theirs.fileno(), self._log.fileno()) > 2  # the others take these places
            self.pid = (self._fork if forks else self._spawn)(theirs.fileno())
        except OSError:
            self._control.close()
            raise
        finally:
            theirs.close()

    def _fork(self, control: int) -> int:
        parent = os.getpid()
        # Until the fork hears no Ctrl-C, which would have it go on as this process would.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            pid = nursery.fork()
            if not pid:
                nursery.begin_forked(control, self._log.fileno(), parent)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return pid

    def _spawn(self, control: int) -> int:
        import subprocess  # most are forks

        child = subprocess.Popen(
            [sys.executable, "-m", nursery.__name__, str(control), str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            pass_fds=[control],
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": _search_path()},
        )
        child.returncode = 0  # it is looked after here
        return child.pid

    def load(self, runner: str, environment: Mapping[str, str], path: Sequence[str]) -> None:
        """Have it load what workers need; where it was told to before, only the variables are as said now.

        Args:
            runner: `module:function` for its workers.
            environment: Variables beside those of this process.
            path: Module search path.
        """
        seen = {**environment, "PYTHONPATH": _search_path()}
        if self._told is None:
            self._tell({"runner": runner, "environment": seen, "path": list(path)})
        elif self._told != seen:
            self._tell({"variables": seen})
        self._told = seen

    def fileno(self) -> int:
        """What becomes readable when it has made a worker, when one has ended, and when it dies itself."""
        return self._control.fileno()

    def make(self, descriptors: Sequence[int], environment: Mapping[str, str], made: Callable[[int], None]) -> None:
        """Ask for a worker; `made` is called with its process id, or with -errno where there can be none.

        Args:
            descriptors: Its socket and its log.
            environment: Variables beside those of the nursery.
            made: Called in `hear`; never, where the nursery dies before.
        """
        self._asked.append(made)
        self._tell({"environment": dict(environment)}, descriptors)

    def hear(self) -> None:
        """Take in what it says: who was made, who has ended."""
        while self._read(socket.MSG_DONTWAIT):
            pass

    def ended(self, pid: int) -> int | None:
        """Exit code of a worker, negative for a signal; None as long as it is not heard to have ended.

        Where the nursery has died, that is what ended its workers.
        """
        return self._codes.get(pid, self._code)

    def wait(self, pid: int, patience_s: float | None) -> int | None:
        """As `ended`, after the end of the worker or `patience_s` [s]; None: as long as it takes."""
        deadline = None if patience_s is None else time.monotonic() + patience_s
        self.hear()
        while self.ended(pid) is None:
            rest_s = None if deadline is None else deadline - time.monotonic()
            if rest_s is not None and rest_s <= 0.0:
                break
            _poll(self._control.fileno(), rest_s)
            self.hear()
        return self.ended(pid)

    def forget(self, pid: int) -> None:
        """Nobody will ask for this worker, which has ended; its process id may be another's from now on."""
        self._tell({"forget": pid})

    def is_running(self) -> bool:
        """Whether it lives."""
        return self._wait(os.WNOHANG) is None

    def code(self) -> int:
        """Its exit code, negative for a signal; it is killed where it lives still."""
        if self._wait(os.WNOHANG) is None:
            os.kill(self.pid, signal.SIGKILL)
        return self._wait(0) or 0

    def end(self) -> None:
        """Let it go, and its workers with it."""
        with suppress(OSError):
            self._control.shutdown(socket.SHUT_WR)
        if self._has_answered:  # one that is loading still would not hear of it for long
            _poll(self._control.fileno(), _GRACE_S)
        self.code()
        self._control.close()

    def log(self) -> bytes:
        """What it printed."""
        return printed(self._log.fileno())

    def _tell(self, message: Mapping[str, Any], descriptors: Sequence[int] = ()) -> None:
        # That it is dead shows in what is read.
        if self._control.fileno() < 0:
            return
        with suppress(BrokenPipeError, ConnectionResetError):
            socket.send_fds(self._control, [json.dumps(message).encode()], descriptors)

    def _read(self, flags: int) -> bool:
        """Take one answer; False where there is none."""
        try:
            data = self._control.recv(MESSAGE, flags) if self._control.fileno() >= 0 else b""
        except BlockingIOError:
            return False
        except ConnectionResetError:
            data = b""
        self.has_news = True
        if not data:
            self.code()
            return False
        self._has_answered = True
        answer = json.loads(data)
        if "ended" in answer:
            self._codes[answer["ended"]] = answer["code"]
        else:
            self._asked.popleft()(answer["pid"] if "pid" in answer else -answer["refused"])
        return True

    def _wait(self, flags: int) -> int | None:
        if self._code is None:
            try:
                pid, status = os.waitpid(self.pid, flags)
            except ChildProcessError:  # this process does not want to know of its children
                pid, status = self.pid, 0
            self._code = os.waitstatus_to_exitcode(status) if pid else None
        return self._code


def _poll(descriptor: int, patience_s: float | None) -> None:
    """Wait until it becomes readable; any descriptor, where `select.select` takes those below 1024."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    poll.poll(None if patience_s is None else patience_s * 1e3)


def _search_path() -> str:
    inherited = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(ROOT), *([inherited] if inherited else [])])
