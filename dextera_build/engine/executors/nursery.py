"""The process that makes workers, seen from the pool; see `engine.nursery`."""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from dextera_build.engine.nursery import MESSAGE
from dextera_build.engine.tasks import printed

_MODULE = "dextera_build.engine.nursery"
_ROOT = Path(__file__).resolve().parents[3]
_LOOK_S = 0.005
_GRACE_S = 1.0


class Nursery:
    """A running nursery.

    Args:
        runner: `module:function` for its workers.
        environment: Variables beside those of this process.
        path: Module search path.

    Raises:
        OSError: No process can be started.
    """

    def __init__(self, runner: str, environment: Mapping[str, str], path: Sequence[str]) -> None:
        self._asked: deque[Callable[[int], None]] = deque()
        """Who asked for a worker and has none yet."""
        self._statuses: dict[int, int | None] = {}
        self.alive = True
        """Whether it was not seen dead."""
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._control.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MESSAGE)
        self._has_answered = False
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-m", _MODULE, runner, str(theirs.fileno()), str(os.getpid())],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                env={**os.environ, **environment, "PYTHONPATH": _search_path()},
            )
        except OSError:
            self._control.close()
            raise
        finally:
            theirs.close()
        self.pid = self._child.pid
        self._tell({"path": list(path)})

    def fileno(self) -> int:
        """What becomes readable when it has made a worker, or dies; -1 when that is over."""
        return self._control.fileno()

    def make(self, descriptors: Sequence[int], environment: Mapping[str, str], made: Callable[[int], None]) -> None:
        """Ask for a worker; `made` is called with its process id, or with -errno where there can be none.

        Args:
            descriptors: Its tasks, file, replies and log.
            environment: Variables beside those of the nursery.
            made: Called in `hear`; never, where the nursery dies before.
        """
        self._asked.append(made)
        self._tell({"environment": dict(environment)}, descriptors)

    def hear(self) -> None:
        """Pass on what it has answered."""
        while self._read(socket.MSG_DONTWAIT):
            pass

    def status(self, pid: int) -> int | None:
        """Exit code of a worker, negative for a signal; None while it runs, and the nursery's where that has died."""
        self._statuses.pop(pid, None)
        self._tell({"look": pid})
        while pid not in self._statuses:
            if not self._read(0):
                return self.code()
        found = self._statuses[pid]
        return None if found is None else os.waitstatus_to_exitcode(found)

    def wait(self, pid: int, watch: int, patience_s: float) -> int | None:
        """As `status`, after its end or `patience_s` [s], whichever is first.

        Args:
            pid: The worker.
            watch: Descriptor that becomes readable when it ends, -1 for none.
            patience_s: How long to wait at most.
        """
        deadline = time.monotonic() + patience_s
        if watch >= 0:
            poll = select.poll()  # any descriptor, where `select` takes those below 1024
            poll.register(watch, select.POLLIN)
            poll.poll(patience_s * 1e3)
        code = self.status(pid)
        while code is None and watch < 0 and time.monotonic() < deadline:
            time.sleep(_LOOK_S)
            code = self.status(pid)
        return code

    def is_running(self) -> bool:
        """Whether it lives."""
        return self.alive and self._child.poll() is None

    def end(self) -> None:
        """Let it go, and its workers with it."""
        self._control.close()
        with suppress(subprocess.TimeoutExpired):
            # One that is loading still would not hear of it for long.
            self._child.wait(_GRACE_S if self._has_answered else 0.0)
        self.code()

    def code(self) -> int:
        """Its exit code; it is killed where it lives still."""
        self.alive = False
        self._child.kill()
        return self._child.wait()

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
        if not data:
            self.alive = False
            return False
        self._has_answered = True
        answer = json.loads(data)
        if "look" in answer:
            self._statuses[answer["look"]] = answer["status"]
        else:
            self._asked.popleft()(answer["pid"] if "pid" in answer else -answer["refused"])
        return True


def _search_path() -> str:
    inherited = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), *([inherited] if inherited else [])])
