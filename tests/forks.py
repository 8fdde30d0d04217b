"""Workers of builds that a test makes in its own process, forked from a process that has loaded what they all load.

A worker spends nine tenths of a small build on imports. A fork of a process that has done them is its own process all
the same: its parent, session, descriptors, variables and exit status are those that the pool asked for. What differs is
its environment as other processes read it (`/proc/<pid>/environ`), so tests of how the pool finds lost processes start
workers as the pool does.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

_WORKER = "dextera_build.workers.worker"
_RUNNER = "dextera_build.running.worker_entry:run_task"
"""The runner of builds."""
_SUBREAPER = 36
_LARGEST = 1 << 17
"""Bound of the size of a request [bytes]."""
_ORPHAN = b"is an orphan"
"""Reply when the process between the nursery and a worker has ended."""
_AT_START = ("PYTHON", "LC_", "LANG", "TZ", "LD_", "MALLOC_", "OMP_", "OPENBLAS_", "MKL_")
"""Variables with such names are read before a worker could be told otherwise."""


class Nursery:
    """A process that forks workers.

    Args:
        environment: Variables that Python and libraries read when they start.
        modules: What it loads beside the runner.
    """

    def __init__(self, environment: Mapping[str, str], modules: Sequence[str]) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        basic = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", __file__, str(theirs.fileno()), *modules],
                pass_fds=[theirs.fileno()],
                env={**basic, **environment},
                stdin=subprocess.DEVNULL,
            )
        self._libc, self._owner, self._turn = ctypes.CDLL(None), os.getpid(), threading.Lock()

    def fork(self, words: Sequence[str], descriptors: Sequence[int], **process: object) -> int:
        """Process id of a new worker, which becomes a child of this process.

        Args:
            words: Its arguments; the second is the place of the socket.
            descriptors: Its log and its socket.
            process: Its variables and folder.
        """
        told = json.dumps({"words": words, **process}).encode()
        with self._turn:
            # A process whose parent has ended goes to the nearest ancestor that asked for such processes.
            self._libc.prctl(_SUBREAPER, 1, 0, 0, 0)
            try:
                socket.send_fds(self._channel, [told], descriptors)
                replies = {self._channel.recv(16), self._channel.recv(16)}
            finally:
                self._libc.prctl(_SUBREAPER, 0, 0, 0, 0)
        return int(*(replies - {_ORPHAN}))

    def close(self) -> None:
        """End the process; its workers stay. A fork of the tests, which holds the channel too, ends nothing."""
        if os.getpid() == self._owner:
            self._channel.shutdown(socket.SHUT_RDWR)
            self._process.wait()


_nurseries: dict[str, Nursery] = {}
_making = threading.Lock()
_loaded: list[str] = []
"""Modules of `workers_with`."""


def _nursery(environment: Mapping[str, str]) -> Nursery:
    at_start = {name: value for name, value in environment.items() if name.startswith(_AT_START)}
    key = json.dumps([os.getpid(), at_start, _loaded], sort_keys=True)
    with _making:
        if key not in _nurseries:
            _nurseries[key] = Nursery(at_start, _loaded)
            atexit.register(_nurseries[key].close)
        return _nurseries[key]


def _started(words: list[str], **asked: Any) -> Any:
    """A worker, in the place of `subprocess.Popen` in the pool; one of a test's own pool is started as ever."""
    *begins, runner, number, parent = words
    if runner != _RUNNER:
        return subprocess.Popen(words, **asked)
    assert begins == [sys.executable, "-P", "-m", _WORKER]
    assert asked["stdout"] is asked["stderr"]
    assert asked["pass_fds"] == [int(number)]
    pid = _nursery(asked["env"]).fork(
        [runner, number, parent],
        [asked["stdout"].fileno(), int(number)],
        environment=asked["env"],
        folder=str(asked["cwd"] or os.getcwd()),
    )
    return SimpleNamespace(pid=pid, returncode=None)


@contextmanager
def forked_workers() -> Iterator[None]:
    """Pools start their workers as forks in the block."""
    from dextera_build.workers import pool

    known = vars(pool)["subprocess"]
    vars(pool)["subprocess"] = SimpleNamespace(Popen=_started, DEVNULL=subprocess.DEVNULL)
    try:
        yield
    finally:
        vars(pool)["subprocess"] = known


@contextmanager
def workers_with(*modules: str) -> Iterator[None]:
    """Forked workers of the block have loaded these modules, which their rules import."""
    known = list(_loaded)
    _loaded[:] = modules
    try:
        yield
    finally:
        _loaded[:] = known


def _serve(channel: socket.socket, modules: Sequence[str]) -> None:
    """Fork a worker for each request until the other end closes."""
    module = _RUNNER.partition(":")[0]
    for name in (module, _WORKER, "dextera_build.workers.leftovers", *modules):
        importlib.import_module(name)
    del sys.modules[module]  # what it does once for its process is done anew in every worker
    gc.freeze()
    while True:
        told, descriptors, _, _ = socket.recv_fds(channel, _LARGEST, 2)
        if not told:
            return
        between = os.fork()
        if not between:
            between = os.getpid()
            if os.fork():
                os._exit(0)
            os.setsid()
            channel.send(str(os.getpid()).encode())  # the pool may kill its group from here on
            channel.close()
            while os.getppid() == between:
                time.sleep(0.0001)
            _become(json.loads(told), *descriptors)
        for each in descriptors:
            os.close(each)
        os.waitpid(between, 0)
        channel.send(_ORPHAN)


def _become(told: dict[str, Any], log: int, pool: int) -> None:
    """Be the worker that was asked for."""
    os.chdir(told["folder"])
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
    os.environ.clear()
    os.environ.update(told["environment"])
    for name in ("random", "numpy.random"):
        if name in sys.modules:
            sys.modules[name].seed()
    sys.modules["__main__"] = sys.modules[_WORKER]  # as for `python -m`
    runner, _, parent = told["words"]
    sys.modules[_WORKER].main([runner, str(pool), parent])


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _serve(socket.socket(fileno=int(sys.argv[1])), sys.argv[2:])
