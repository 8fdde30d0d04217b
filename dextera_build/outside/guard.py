"""The process between a worker and a program: starts it, watches its limits, and leaves nothing of it behind.

    python -I -S guard.py <descriptor of a socket>

The first line on the socket is a `Spec`, each further line a task; the guard answers with JSON lines. When the socket
closes, because the worker is done or dead, or when a limit is exceeded, it kills the program with everything that it
started. Orphans become children of the guard (`PR_SET_CHILD_SUBREAPER`), so processes that left the session, ignore
signals or forked twice are found too.

This file imports nothing outside the standard library, because it starts once per call.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import selectors
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from typing import Any

MARKER = "DXB_OUTSIDE"
"""Environment variable by which all processes of a program are known."""
SIGN = "@dxb "
"""Beginning of the lines that a program prints for dxb; all other lines are its log."""
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_LOOK_S = 0.05
"""Interval at which limits are checked [s]."""
_LEFT_S = 2.0
"""How long processes may outlive a program that has ended [s]."""
_KILL_S = 10.0
_PIECE = 1 << 16
"""Longest line [bytes]; longer ones are cut."""
_TAIL = 1 << 16
"""This much of the end of a long log is kept [bytes]."""
_PROGRESS_S = 0.05

Spec = dict[str, Any]
"""`argv`, `cwd`, `env`, `root` (its temporary folder), `server`, `memory` and `disk` [bytes], `log` [bytes], `idle_s`,
`last` (a command that removes processes that are not children, such as a container)."""


class Guard:
    """Serves one program until the socket closes or the program ends.

    Args:
        worker: Socket connected to the worker.
    """

    def __init__(self, worker: socket.socket) -> None:
        self._worker = worker
        self._told = b""
        self._spec: Spec = {}
        self._task: dict[str, Any] | None = None
        self._began = self._free_since = time.monotonic()
        self._program: subprocess.Popen[bytes] | None = None
        self._output = Output(self._say)
        self._peak = 0
        self._over = False
        self._next_look = 0.0
        self._selector = selectors.DefaultSelector()

    def serve(self) -> None:
        """Run tasks until nothing is left to do."""
        self._selector.register(self._worker, selectors.EVENT_READ)
        try:
            while self._hear() and self._step():
                pass
        finally:
            kill_below(os.getpid())
            while self._over and self._worker.recv(1 << 16):
                pass  # the worker still reads the response
            if self._spec:
                with contextlib.suppress(OSError, subprocess.TimeoutExpired):
                    if self._spec["last"]:
                        subprocess.run(self._spec["last"], capture_output=True, timeout=_KILL_S, check=False)
                _remove(self._spec["root"])

    def _hear(self) -> bool:
        """Wait for lines of the worker, output or the next look; False once the worker is gone."""
        for key, _ in self._selector.select(_LOOK_S if self._task else min(1.0, self._spec.get("idle_s", 1.0))):
            if key.fileobj is not self._worker:
                if not self._output.read(key.fd):
                    self._selector.unregister(key.fd)
                continue
            with contextlib.suppress(BlockingIOError):
                part = self._worker.recv(1 << 20)
                if not part:
                    return False
                self._told += part
        *lines, self._told = self._told.split(b"\n")
        for line in lines:
            self._take(json.loads(line))
        return True

    def _take(self, message: dict[str, Any]) -> None:
        if not self._spec:
            self._spec = message
            self._output.most = message["log"]
            return
        self._task, self._began = message, time.monotonic()
        self._output.begin()
        try:
            if self._program is None:
                self._start()
            if self._spec["server"]:
                assert self._program is not None
                assert self._program.stdin is not None
                self._program.stdin.write(json.dumps({"folder": message["folder"]}).encode() + b"\n")
                self._program.stdin.flush()
        except BrokenPipeError:
            pass  # it has ended, as `_step` will see
        except OSError as error:
            self._end("start", error=error.strerror)

    def _start(self) -> None:
        server, spec = self._spec["server"], self._spec
        argv = spec["argv"] if server else [*spec["argv"], self._task["folder"]]  # type: ignore[index]
        libc = ctypes.CDLL(None)
        most = spec["disk"] or resource.RLIM_INFINITY

        def prepare() -> None:
            libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
            soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

        self._program = subprocess.Popen(
            argv,
            cwd=spec["cwd"],
            env=spec["env"],
            stdin=subprocess.PIPE if server else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=prepare,
        )
        assert self._program.stdout is not None
        os.set_blocking(self._program.stdout.fileno(), False)
        self._selector.register(self._program.stdout.fileno(), selectors.EVENT_READ)

    def _step(self) -> bool:
        """Look at the program; False once there is nothing left to serve."""
        if self._over:
            return False
        if self._task is None:
            idle = time.monotonic() - self._free_since > self._spec.get("idle_s", 60.0)
            return not idle and not self._has_ended()
        if self._output.done == self._task["folder"]:
            return self._end("done")
        if self._has_ended():
            return self._leave()
        now = time.monotonic()
        if now - self._began > self._task["timeout_s"]:
            return self._end("timeout")
        if now < self._next_look:
            return True
        self._peak = max(self._peak, memory_below(os.getpid()))
        if 0 < self._spec["memory"] < self._peak:
            return self._end("memory")
        if 0 < self._spec["disk"] < self._written():
            return self._end("disk")
        # A folder of many files takes long to measure: at most a tenth of the time goes into that.
        self._next_look = now + max(_LOOK_S, 10 * (time.monotonic() - now))
        return True

    def _has_ended(self) -> bool:
        return self._program is not None and self._program.poll() is not None

    def _leave(self) -> bool:
        """The end of a program that ended by itself; processes that it leaves behind are counted."""
        assert self._program is not None
        code = self._program.returncode
        deadline = time.monotonic() + _LEFT_S
        while (left := below(os.getpid())) and time.monotonic() < deadline:
            self._drain()
            time.sleep(0.01)
        kill_below(os.getpid())
        self._drain()
        full = 0 < self._spec["disk"] <= max(self._written(), _largest(self._spec["root"]))
        return self._end("disk" if full else "signal" if code < 0 else "exit", code=abs(code), left=len(left))

    def _drain(self) -> None:
        assert self._program is not None
        assert self._program.stdout is not None
        with contextlib.suppress(ValueError, OSError):
            self._output.read(self._program.stdout.fileno())

    def _written(self) -> int:
        """Disk space below its temporary folder without the requests, and of files without a name [bytes]."""
        return _size(self._spec["root"], without="request") + _unnamed_below(os.getpid())

    def _end(self, why: str, **facts: Any) -> bool:
        """Report the end of the task; True if the program continues."""
        goes_on = why == "done"
        self._over = not goes_on
        if not goes_on:
            kill_below(os.getpid())
            if self._program is not None:
                self._drain()
        self._output.finish()
        facts |= {"why": why, "left_out": self._output.left_out, "peak": self._peak}
        self._task, self._free_since = None, time.monotonic()
        self._say({"ended": facts})
        return goes_on

    def _say(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # the worker is gone, as `_hear` will see
            self._worker.sendall(json.dumps(message).encode() + b"\n")


class Output:
    """The output of a program: lines for dxb, progress, and a log of bounded length.

    Args:
        say: Takes messages for the worker.
    """

    def __init__(self, say: Any) -> None:
        self._say = say
        self.most = 0
        """How much of a log is passed on at once [bytes]."""
        self.begin()

    def begin(self) -> None:
        """Start with a new task."""
        self.done = ""
        self._buffer = self._tail = b""
        self._passed = self._held = 0
        self.left_out = 0
        self._last_progress = 0.0

    def read(self, descriptor: int) -> bool:
        """Take the available output, at most one piece; False at the end of the output."""
        try:
            part = os.read(descriptor, _PIECE)
        except BlockingIOError:
            return True
        if not part:
            return False
        *lines, self._buffer = (self._buffer + part).split(b"\n")
        for line in lines:
            self._line(line)
        if len(self._buffer) > _PIECE:
            self._line(self._buffer)
            self._buffer = b""
        return True

    def finish(self) -> None:
        """Pass on the last line, and the end of a long log."""
        if self._buffer:
            self._line(self._buffer)
        if self._held:
            self.left_out = max(0, self._held - len(self._tail))
            said = f"[{self.left_out:,} bytes of output left out]\n" if self.left_out else ""
            self._say({"log": said + self._tail.decode(errors="replace").rstrip("\n")})
        self._buffer = self._tail = b""
        self._held = 0

    def _line(self, line: bytes) -> None:
        if line.startswith(SIGN.encode()):
            with contextlib.suppress(ValueError):
                self._message(json.loads(line[len(SIGN) :]))
                return
        size = len(line) + 1
        if self._passed + size <= self.most:
            self._passed += size
            self._say({"log": line.decode(errors="replace")})
        else:
            self._held += size
            self._tail = (self._tail + line + b"\n")[-_TAIL:]

    def _message(self, message: Any) -> None:
        if not isinstance(message, dict):
            raise ValueError(message)
        if isinstance(message.get("done"), str):
            self.done = message["done"]
        now = time.monotonic()
        if isinstance(message.get("progress"), list) and now - self._last_progress > _PROGRESS_S:
            self._last_progress = now
            self._say({"progress": message["progress"]})


def below(pid: int) -> list[int]:
    """Process ids of all living descendants of a process."""
    children: dict[int, list[int]] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError), open(f"/proc/{name}/stat", "rb") as told:
                state, parent = told.read().rpartition(b")")[2].split()[:2]
                children.setdefault(int(parent), []).append(-int(name) if state in b"ZX" else int(name))
    found, todo = [], [pid]
    while todo:
        for child in children.get(todo.pop(), ()):
            todo.append(abs(child))
            if child > 0:
                found.append(child)
    return found


def kill(pids: list[int]) -> None:
    """Kill processes; first all are stopped, so that none starts another meanwhile."""
    for number in (signal.SIGSTOP, signal.SIGKILL):
        for pid in pids:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, number)


def kill_below(pid: int) -> None:
    """Kill all descendants of this process, and wait for their end."""
    deadline = time.monotonic() + _KILL_S
    while (found := below(pid)) and time.monotonic() < deadline:
        kill(found)
        time.sleep(0.002)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass


def memory_below(pid: int) -> int:
    """Memory of all descendants [bytes]: anonymous and shared pages, no mapped files."""
    total = 0
    for child in below(pid):
        with contextlib.suppress(OSError, ValueError), open(f"/proc/{child}/status") as status:
            for line in status:
                if line.startswith(("RssAnon:", "RssShmem:")):
                    total += int(line.split()[1]) * 1024
    return total


def _size(root: str, without: str = "") -> int:
    """Disk space of a folder [bytes]; links are not followed."""
    total, todo = 0, [root]
    while todo:
        with contextlib.suppress(OSError), os.scandir(todo.pop()) as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    if not entry.is_dir(follow_symlinks=False):
                        total += entry.stat(follow_symlinks=False).st_blocks * 512
                    elif entry.name != without:
                        todo.append(entry.path)
    return total


def _unnamed_below(pid: int) -> int:
    """Disk space of deleted files that descendants hold open [bytes]."""
    found = {}
    for child in below(pid):
        with contextlib.suppress(OSError), os.scandir(f"/proc/{child}/fd") as entries:
            for entry in entries:
                with contextlib.suppress(OSError):
                    facts = entry.stat()
                    if stat.S_ISREG(facts.st_mode) and not facts.st_nlink:
                        found[facts.st_dev, facts.st_ino] = facts.st_blocks * 512
    return sum(found.values())


def _largest(root: str) -> int:
    """Size of the largest file in a folder [bytes]; a write beyond the limit leaves one of that size."""
    sizes = [0]
    for folder, _, names in os.walk(root):
        for name in names:
            with contextlib.suppress(OSError):
                sizes.append(os.lstat(os.path.join(folder, name)).st_size)
    return max(sizes)


def _remove(root: str) -> None:
    """Remove a folder, with folders in it that forbid it."""
    shutil.rmtree(root, ignore_errors=True)
    if os.path.isdir(root):
        for folder, _, _ in os.walk(root):
            with contextlib.suppress(OSError):
                os.chmod(folder, 0o700)
        shutil.rmtree(root, ignore_errors=True)


def main() -> None:
    """Entry point; see the module docstring."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    worker = socket.socket(fileno=int(sys.argv[1]))
    os.set_inheritable(worker.fileno(), False)
    Guard(worker).serve()


if __name__ == "__main__":
    main()
