"""A pool of worker processes on this machine: their tasks, their messages, and how they died."""

from __future__ import annotations

import contextlib
import fcntl
import json
import math
import os
import resource
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Self

from dextera_build.calls import secrets
from dextera_build.errors import MachineError, RuleError, from_json
from dextera_build.outside import program_side
from dextera_build.redact import redact_plain
from dextera_build.workers import family, warm, worker
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.protocol import Ended, Report, Said, Task, printed

_GRACE_S = 1.0
_LOOK_S = 0.25
"""Interval at which busy workers are checked [s]."""
_WAIT_S = 0.001
_TAIL_LINES = 12
_ROOT = Path(__file__).resolve().parents[2]
"""Folder that contains this package."""
_SIDE = os.path.dirname(program_side.__file__)


class LocalExecutor:
    """Workers, started on demand and reused; use it as a context manager.

    A worker ends with the thread that started it (Linux signals the death of the parent thread), so build from a
    thread that outlives the build.

    Args:
        runner: `module:function` that executes a task in a worker.
        capacity: Resources shared by tasks.
        environment: Variables for workers, in addition to those of this process.
        folder: The folder that workers start in; None: that of this process.
    """

    def __init__(
        self,
        runner: str,
        capacity: Capacity,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
    ) -> None:
        self.capacity = capacity
        self._runner = runner
        self._environment, self._folder = dict(environment or {}), folder
        self._selector = selectors.DefaultSelector()
        self._workers: list[Process] = []
        self._waiting: list[Task] = []
        """Tasks without an idle worker; a worker is loading for each, but any worker that becomes free takes it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.stop()

    def warm(self) -> None:
        """Start a worker before its first task is known, so that its imports are done by then."""
        self._start(())

    def submit(self, task: Task) -> None:
        """Give the task to an idle worker, or to the next one that becomes free, as loading another may take longer."""
        process = self._idle(task)
        for other in warm.surplus(self._workers, task, process, self.capacity):
            self._end(other, 0.0)
        if process is not None:
            process.give(task)
            return
        loading = sum(other.devices == task.devices and not other.is_ready for other in self._workers)
        if loading <= sum(other.devices == task.devices for other in self._waiting):
            self._start(task.devices)
        self._waiting.append(task)

    def poll(self, timeout_s: float | None) -> list[Report]:
        """Reports of workers; a worker that died is reported as the failure of its node."""
        reports: list[Report] = []
        patience = timeout_s if timeout_s is not None else math.inf
        # The socket may not show a worker's death: a process that it started may hold the other end.
        patience = min(patience, _LOOK_S) if self._busy() else patience
        for key, _ in self._selector.select(patience if patience < math.inf else None):
            reports += self._hear(key.data)
        for process in [process for process in self._busy() if process.has_ended]:
            reports += self._hear(process)
        for process in [process for process in self._workers if process.is_stale]:
            self._end(process, 0.0)
        return reports

    def stop(self) -> None:
        """End all workers and the processes they started; busy workers may clean up first."""
        for process in self._busy():
            process.ask_to_end()
        began = time.monotonic()
        while self._workers:
            process = self._workers[0]
            patience_s = process.grace_s - (time.monotonic() - began) if process.task else 0.0
            self._end(process, max(0.0, patience_s))
        self._waiting.clear()

    def pids(self) -> list[int]:
        """Process ids of all workers."""
        return [process.pid for process in self._workers]

    def _busy(self) -> list[Process]:
        return [process for process in self._workers if process.task is not None]

    def _idle(self, task: Task) -> Process | None:
        """An idle worker for a task, with the devices granted to it."""
        able = []
        for process in [process for process in self._workers if process.is_ready and process.task is None]:
            if process.devices != task.devices and set(process.devices).isdisjoint(task.devices):
                continue
            if process.devices == task.devices and not process.has_ended:
                able.append(process)
            else:  # it is dead, or holds memory of a device that another worker needs now
                self._end(process, 0.0)
        return warm.choose(able, task)

    def _start(self, devices: tuple[str, ...]) -> None:
        try:
            process = Process(self._runner, self._environment, self._folder, devices)
        except OSError as error:
            raise MachineError(
                "a worker process cannot be started",
                code="DXB-E202",
                facts={"system says": error.strerror, "workers": len(self._busy())},
                hint="build with `--jobs 1`",
            ) from None
        self._selector.register(process.descriptor, selectors.EVENT_READ, process)
        self._workers.append(process)

    def _hear(self, process: Process) -> list[Report]:
        lines, ended = process.hear()
        reports: list[Report] = []
        try:
            for line in lines:
                reports += process.understand(line)
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
            process.fault, ended = "sent an invalid message", True
        if ended or process.leaves:
            return reports + self._bury(process)
        if process.is_ready and process.task is None and (task := self._next(process)) is not None:
            process.give(task)
        return reports

    def _next(self, process: Process) -> Task | None:
        """Take the first task that waits for such a worker."""
        able = (task for task in self._waiting if task.devices == process.devices and warm.takes(process, task))
        task = next(able, None)
        if task is not None:
            self._waiting.remove(task)
        return task

    def _bury(self, process: Process) -> list[Report]:
        """Remove a worker that is dead or must go; fails its task or, if it never had one, a task that waits for it."""
        self._end(process, 0.0 if process.leaves or process.fault else _GRACE_S)
        task = self._next(process) if process.is_fresh else process.task
        if task is None:
            return []
        seconds, log = time.monotonic() - process.began, process.log()
        return [Ended(task.ticket, seconds, log, error=process.death(log), usage={"memory_bytes": process.peak})]

    def _end(self, process: Process, patience_s: float) -> None:
        self._workers.remove(process)
        self._selector.unregister(process.descriptor)
        process.end(patience_s)


class Process:
    """A worker process: a separate interpreter that shares only the module search path with this process.

    It leads its own session and process group: Ctrl-C at the terminal does not reach it, and it can be killed together
    with the processes it started. It accepts a task while it is still loading.

    Args:
        runner: `module:function` that executes a task.
        environment: Variables in addition to those of this process.
        folder: See `LocalExecutor`.
        devices: GPUs that it may use.

    Raises:
        OSError: The process cannot be started, or its log file cannot be opened.
    """

    def __init__(
        self, runner: str, environment: Mapping[str, str], folder: Path | None = None, devices: tuple[str, ...] = ()
    ) -> None:
        self.task: Task | None = None
        """Its current task, not answered yet."""
        self.devices = devices
        self.is_ready = False
        """Whether it has loaded the runner."""
        self.is_fresh = True
        """Whether it was given no task so far."""
        self.leaves = False
        """Whether its last task left something behind that the next one must not find."""
        self.fault = ""
        """Fault of its last message."""
        self.began = time.monotonic()
        """Start of its task or of loading, by `time.monotonic`."""
        self.secrets: set[str] = set()
        """Names of secrets that its tasks requested; a dead worker's log is read without its help."""
        self.grace_s = _GRACE_S
        """How long it may take to clean up when a build is cut short [s]."""
        self.peak = 0
        """Peak memory of the worker and its children [bytes]; set by `end`."""
        self.holds: tuple[str, ...] = ()
        """Weights of the model that it keeps; see `warm`, also for the next three."""
        self.held_gb = self.held_gpu_gb = 0.0
        self.idle_since = self.began
        self._buffer = b""
        self._mark = os.urandom(16).hex()
        # Unnamed, so that no file is left behind however the process ends.
        self._log = tempfile.TemporaryFile(mode="w+b", buffering=0)  # noqa: SIM115
        # With O_APPEND, output after a truncation goes to the start of the file.
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
                    cwd=folder,
                    start_new_session=True,
                    # CUDA reads this variable once per process, so a worker keeps its devices.
                    env={
                        **secrets.for_workers(),
                        **environment,
                        "CUDA_VISIBLE_DEVICES": ",".join(devices),
                        family.MARKER: self._mark,
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
        """Descriptor that becomes readable when the worker sends a line or dies; -1 after `end`."""
        return self._socket.fileno()

    @property
    def has_ended(self) -> bool:
        """Whether it is dead, even if a process that it started still holds the socket."""
        try:
            # WNOWAIT keeps its process id reserved until `end` has killed its group.
            return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        except ChildProcessError:  # the embedding program ignores SIGCHLD
            return True

    def give(self, task: Task) -> None:
        """Give it a task; `hear` reports a worker that is already dead."""
        self.task, self.is_fresh, self.began, self.grace_s = task, False, time.monotonic(), _GRACE_S
        self._send(json.dumps(task.message()).encode())

    def rest(self) -> None:
        """Note the end of its task, and the weights that it keeps in memory."""
        assert self.task is not None
        self.idle_since = time.monotonic()
        if self.task.weights:
            self.holds, self.held_gb, self.held_gpu_gb = self.task.weights, self._memory_gb(), self.task.needs.gpu_gb
        self.task = None

    @property
    def is_stale(self) -> bool:
        """Whether it holds a model that nothing has used for a while."""
        return bool(self.holds) and self.task is None and time.monotonic() - self.idle_since > warm.IDLE_S

    def _memory_gb(self) -> float:
        with contextlib.suppress(OSError), open(f"/proc/{self.pid}/statm") as table:
            return int(table.read().split()[1]) * resource.getpagesize() / 2**30
        return 0.0

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self._socket.sendall(data + b"\n")

    def understand(self, line: bytes) -> list[Report]:
        """The reports of a line that it sent; a task can write anything to the socket, so a line may be no message."""
        message = json.loads(line)
        if "ready" in message:
            self.is_ready = True
        elif self.task is None:  # leftover threads of an ended task may still send lines
            pass
        elif "said" in message:
            kind, data = message["said"]
            if kind == "grace":
                self.grace_s = float(data["seconds"])
            elif kind == "secret":
                self.secrets.add(data["name"])
            else:
                return [Said(self.task.ticket, kind, data)]
        else:
            self.leaves = bool(message.pop("leaves"))
            log, error = message["log"].encode("latin-1"), from_json(message["error"]) if message["error"] else None
            end = Ended(**{**message, "ticket": self.task.ticket, "log": log, "error": error})
            self.rest()
            return [end]
        return []

    def hear(self) -> tuple[list[bytes], bool]:
        """(received lines, whether it is dead)."""
        ended = self.has_ended
        with contextlib.suppress(BlockingIOError, ConnectionResetError):  # a reset: it died with a task unread
            while part := self._socket.recv(1 << 16, socket.MSG_DONTWAIT):
                self._buffer += part
            ended = True
        *lines, self._buffer = self._buffer.split(b"\n")
        return lines, ended

    def ask_to_end(self) -> None:
        """Ask it to clean up and end."""
        if not self.has_ended:
            os.kill(self.pid, signal.SIGTERM)

    def end(self, patience_s: float) -> None:
        """Wait at most `patience_s` [s] for its end, then kill it and every process that it started."""
        deadline = time.monotonic() + patience_s
        while not self.has_ended and time.monotonic() < deadline:
            time.sleep(_WAIT_S)
        family.end(self.pid, self._mark)
        try:
            _, status, used = os.wait4(self.pid, 0)
            self._child.returncode, self.peak = os.waitstatus_to_exitcode(status), used.ru_maxrss * 1024
        except ChildProcessError:  # the embedding program ignores SIGCHLD
            self._child.returncode = 0
        self._socket.close()

    def log(self) -> bytes:
        """Output of the node so far."""
        for name in self.secrets:
            with contextlib.suppress(MachineError):
                secrets.get(name)
        log: bytes = redact_plain(printed(self._log.fileno()))
        return log

    def death(self, log: bytes) -> RuleError:
        """The error for a worker that died while running a node; call it after `end`."""
        code = self._child.returncode
        if code < 0:
            names = {known.value: known.name for known in signal.Signals}
            reason, facts = f"signal {-code}", {"signal": f"{-code} ({names.get(-code, 'unknown')})"}
        else:
            reason, facts = f"exit code {code}", {"exit code": str(code)}
        if self.fault:
            reason, facts = self.fault, {}
        tail = log.decode(errors="replace").strip().splitlines()
        # A fatal-error traceback of Python begins with the innermost call.
        fatal = next((place for place, line in enumerate(tail) if line.startswith("Fatal Python error")), None)
        tail = tail[-_TAIL_LINES:] if fatal is None else tail[fatal : fatal + _TAIL_LINES]
        if tail:
            facts["printed"] = "\n".join(tail)
        return RuleError(
            f"worker died ({reason})",
            code="DXB-B301",
            facts=facts,
            hint="build again, with `--jobs 1` where memory is short",
        )


def _search_path() -> str:
    """PYTHONPATH of workers; first the folder of the `sitecustomize` that keeps stale byte code from running."""
    inherited = os.environ.get("PYTHONPATH")
    entries = map(os.path.abspath, inherited.split(os.pathsep)) if inherited else ()
    return os.pathsep.join([_SIDE, str(_ROOT), *entries])
