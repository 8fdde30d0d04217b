"""The worker's side of a program: sends requests through a guard, passes on its output, and explains how it ended."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from dextera_build.errors import DxbError, MachineError, RuleError
from dextera_build.outside import guard
from dextera_build.outside.marked import marked
from dextera_build.outside.messages import REQUEST, RESPONSE

Emit = Callable[[str, Mapping[str, object]], None]
_LOG = 1 << 20
"""How much output of a program is passed on as it comes [bytes]; of the rest, the end is kept."""
_TAIL_LINES = 4
_END_S = 15.0
_SPARE_S = 5.0
_GIB = 1 << 30


@dataclass(frozen=True)
class Limits:
    """Limits of a program."""

    timeout_s: float
    """Duration of a call [s]."""
    memory_gb: float
    """Memory of all its processes [GiB]; 0 for any."""
    disk_gb: float
    """Space of its response and its temporary files [GiB]."""
    idle_s: float = 300.0
    """How long a server waits for the next call [s]."""


class Running:
    """A program behind its guard; use it as a context manager, or keep it for the next calls if it is a server.

    Args:
        argv: Its command, for a command without the folder of the request; takes the root of its exchanges.
        here: The folder it starts in.
        limits: Its limits.
        environment: Variables in addition to those of this process.
        last: Takes the root; a command that ends processes that are not children, or nothing.
        server: Whether it answers several requests.
    """

    def __init__(
        self,
        argv: Callable[[Path], list[str]],
        here: Path,
        limits: Limits,
        environment: Mapping[str, str],
        *,
        last: Callable[[Path], list[str]],
        server: bool,
    ) -> None:
        self.limits, self.server = limits, server
        self._mark = uuid.uuid4().hex
        self._count = 0
        self._used = time.monotonic()
        self._buffer = b""
        self._tail: list[str] = []
        self._root = Path(tempfile.mkdtemp(prefix="dxb-outside-")).resolve()
        (self._root / "tmp").mkdir()
        self._socket, theirs = socket.socketpair()
        try:
            with theirs:
                self._guard = subprocess.Popen(
                    [sys.executable, "-I", "-S", guard.__file__, str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    pass_fds=[theirs.fileno()],
                    start_new_session=True,
                    env={**os.environ, guard.MARKER: self._mark},
                )
        except OSError as error:
            self._socket.close()
            shutil.rmtree(self._root, ignore_errors=True)
            raise _no_start("the process that watches a program", str(error.strerror)) from None
        own = {"TMPDIR": str(self._root / "tmp"), guard.MARKER: self._mark, **environment}
        self._send(
            {
                "argv": argv(self._root),
                "cwd": str(here),
                "env": {**_inherited(), **own},
                "root": str(self._root),
                "server": server,
                "memory": int(limits.memory_gb * _GIB),
                "disk": int(limits.disk_gb * _GIB),
                "log": _LOG,
                "idle_s": limits.idle_s,
                "last": last(self._root),
            }
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.end()

    @property
    def is_alive(self) -> bool:
        """Whether it can take a request: it is not about to end after a long time without a request."""
        idle_s = time.monotonic() - self._used
        return self._guard.poll() is None and idle_s < self.limits.idle_s - _SPARE_S

    def exchange(self) -> Path:
        """A new folder with empty folders for a request and a response; it vanishes with the program."""
        self._count += 1
        self._used = time.monotonic()
        folder = self._root / str(self._count)
        for name in (REQUEST, RESPONSE):
            (folder / name).mkdir(parents=True)
        return folder

    def ask(self, folder: Path, emit: Emit) -> None:
        """Let it answer the request in `folder`; its output is printed.

        Args:
            folder: From `exchange`.
            emit: Takes its progress.

        Raises:
            RuleError: It crashed, exceeded a limit, or left processes behind.
            MachineError: It cannot be started.
        """
        self._tail = []
        try:
            self._send({"folder": str(folder), "timeout_s": self.limits.timeout_s})
            ended = self._hear(emit)
        except BaseException:
            self.end()
            raise
        error = self._fault(ended)
        if error is not None:
            self.end()
            raise error
        self._used = time.monotonic()

    def end(self) -> None:
        """End it, with every process that it started and its folder."""
        self._socket.close()
        try:
            self._guard.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._guard.kill()
            self._guard.wait()
        if self._guard.returncode < 0:  # something killed the guard before it could kill
            while found := marked(f"{guard.MARKER}={self._mark}"):
                guard.kill(found)
        shutil.rmtree(self._root, ignore_errors=True)

    def _send(self, message: Mapping[str, object]) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # `_hear` reports a dead guard
            self._socket.sendall(json.dumps(message).encode() + b"\n")

    def _hear(self, emit: Emit) -> dict[str, Any]:
        """Pass on its output until the task has ended."""
        while True:
            *lines, self._buffer = self._buffer.split(b"\n")
            for place, line in enumerate(lines):
                message = json.loads(line)
                if "ended" in message:
                    self._buffer = b"\n".join([*lines[place + 1 :], self._buffer])
                    found: dict[str, Any] = message["ended"]
                    return found
                self._pass_on(message, emit)
            try:
                part = self._socket.recv(1 << 16)
            except ConnectionResetError:
                part = b""
            if not part:
                return {"why": "guard", "code": self._guard.wait()}
            self._buffer += part

    def _pass_on(self, message: Mapping[str, Any], emit: Emit) -> None:
        if "log" in message:
            print(message["log"], flush=True)
            self._tail = [*self._tail, *str(message["log"]).splitlines()][-_TAIL_LINES:]
            return
        with contextlib.suppress(ValueError, TypeError, OverflowError):
            done, total, what = message["progress"]
            emit("progress", {"done": int(done), "total": int(total), "what": str(what)[:200]})

    def _fault(self, ended: Mapping[str, Any]) -> DxbError | None:
        """The error for the way in which a task ended; None if a response may be there."""
        why, code, limits = ended["why"], ended.get("code", 0), self.limits
        if why == "start":
            return _no_start("the program", str(ended["error"]))
        if why == "guard":
            return MachineError(
                "the process that watches a program was killed",
                code="DXB-E391",
                facts={"exit code": code},
                hint="build again, with `--jobs 1` where memory is short",
            )
        facts: dict[str, object] = {}
        if ended.get("left_out"):
            facts["output"] = f"{ended['left_out']:,} bytes left out of the log"
        if self._tail:
            facts["printed"] = "\n".join(self._tail)  # not `log`: the build puts the command for all of it there
        if why == "timeout":
            return RuleError(
                f"the program took longer than {limits.timeout_s:g} s",
                code="DXB-B371",
                facts=facts,
                hint="raise `timeout_s` of the backend, or find the cause in `dxb log`",
            )
        if why == "memory":
            return RuleError(
                f"the program needed more than {limits.memory_gb:g} GiB of memory",
                code="DXB-B372",
                facts={"peak": f"{ended['peak'] / _GIB:.3g} GiB", **facts},
                hint="raise `memory_gb` of the backend, or give it less to work on",
            )
        if why == "disk":
            return RuleError(
                f"the program wrote more than {limits.disk_gb:g} GiB",
                code="DXB-B373",
                facts={"counted": "the response and its temporary files", **facts},
                hint="raise `disk_gb` of the backend, or let the program write less",
            )
        return self._crash(why, code, facts) or _left(ended.get("left", 0), facts)

    def _crash(self, why: str, code: int, facts: dict[str, object]) -> RuleError | None:
        if why == "done" or (why == "exit" and not code and not self.server):
            return None
        how = f"signal {code} ({_signal(code)})" if why == "signal" else f"exit code {code}"
        return RuleError(
            f"the program failed ({how})",
            code="DXB-B370",
            facts=facts,
            hint="`dxb log` shows everything that it printed",
        )


def _left(count: int, facts: dict[str, object]) -> RuleError | None:
    if not count:
        return None
    return RuleError(
        f"the program ended, but left {count} {'process' if count == 1 else 'processes'} running",
        code="DXB-B377",
        facts=facts,
        hint="let it wait for the processes that it starts; they were killed, and its answer was dropped",
    )


def _no_start(what: str, why: str) -> MachineError:
    return MachineError(
        f"{what} cannot be started: {why}",
        code="DXB-E390",
        facts={"machine": os.uname().nodename},
        hint="`dxb doctor` shows what backends need",
    )


def _signal(number: int) -> str:
    import signal

    return {known.value: known.name for known in signal.Signals}.get(number, "unknown")


def _inherited() -> dict[str, str]:
    """This process's environment without the variables that lead another Python to the modules of this one."""
    own = ("PYTHONPATH", "PYTHONHOME", "PYTHONSAFEPATH", "VIRTUAL_ENV", "DEXTERA_CODE")
    kept = {name: value for name, value in os.environ.items() if name not in own}
    return {**kept, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONUNBUFFERED": "1"}
