"""A process that has loaded what workers need, and makes workers: each is a fork of it.

    python -m dextera_build.engine.nursery <descriptor of a socket> <process id>

So a worker costs a few milliseconds, where an interpreter that starts and imports costs a few hundred. Nothing of a
project is loaded here, no rule, no numpy and nothing that starts threads: what a worker makes of itself no other sees.

Each message of the socket is JSON. First comes what to load: `{"runner": "module:function", "path": [...],
"environment": {...}}`, with the pool's module search path. Then `{"environment": {...}}`, with the descriptors of
socket and log, asks for a worker, and is answered with `{"pid": ...}` or `{"refused": errno}`, in the
order of asking. When a worker ends, `{"ended": pid, "code": ...}` says so, and after `{"forget": pid}` its id may be
another's. `{"variables": {...}}` sets these for workers to come. The nursery ends when the socket closes and when its
parent dies, and its workers with it.
"""

from __future__ import annotations

import ctypes
import errno
import faulthandler
import gc
import json
import os
import select
import signal
import socket
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from dextera_build.engine import worker
from dextera_build.store import failpoints

MESSAGE = 1 << 20
"""No message takes more [bytes]."""
_YOUNG = (700, 10, 10)
"""When Python looks for objects that nobody reaches, as it does by itself."""
ROOT = Path(__file__).resolve().parents[2]
"""Where this package lies."""


class Nursery:
    """Answers until the socket closes.

    Args:
        control: The socket.
    """

    def __init__(self, control: socket.socket) -> None:
        self._control = control
        self._pid = os.getpid()
        self._living: list[int] = []
        self._woken, self._waking = os.pipe()

    def serve(self) -> list[str]:
        """Load what workers need, then make them; returns in each fork, with the arguments of the worker to be."""
        data = self._control.recv(MESSAGE)
        if not data:
            os._exit(0)
        told = json.loads(data)
        os.environ.update(told["environment"])
        sys.path += [entry for entry in told["path"] if entry not in sys.path]
        gc.disable()
        with suppress(Exception):  # the worker says what is wrong, to whoever gives it a task
            worker.load(told["runner"])
        # What is here stays: no worker need look at it again, and so copy its pages.
        gc.freeze()
        gc.set_threshold(*_YOUNG)
        gc.enable()
        os.set_blocking(self._woken, False)
        os.set_blocking(self._waking, False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        signal.set_wakeup_fd(self._waking)
        poll = select.poll()
        poll.register(self._control, select.POLLIN)
        poll.register(self._woken, select.POLLIN)
        while True:
            for descriptor, _ in poll.poll():
                if descriptor == self._woken:
                    self._announce()
                elif words := self._answer(told["runner"]):
                    return words

    def _answer(self, runner: str) -> list[str]:
        """Do what the next message asks for; in a new worker, its arguments."""
        data, descriptors, _, _ = socket.recv_fds(self._control, MESSAGE, 4, socket.MSG_CMSG_CLOEXEC)
        if not data:
            os._exit(0)
        message = json.loads(data)
        if "forget" in message:
            os.waitpid(message["forget"], 0)
            return []
        if "variables" in message:
            os.environ.update(message["variables"])
            return []
        pid = self._make(runner, message["environment"], descriptors)
        if not pid:
            return self._become(runner, message["environment"], descriptors)
        for descriptor in descriptors:
            os.close(descriptor)
        self._say({"pid": pid} if pid > 0 else {"refused": -pid})
        if pid > 0:
            self._living.append(pid)
        return []

    def _announce(self) -> None:
        """Say which workers have ended; that they are still known keeps others from their ids."""
        with suppress(BlockingIOError):
            os.read(self._woken, 1 << 12)
        for pid in list(self._living):
            if ended := os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                self._living.remove(pid)
                code = ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status
                self._say({"ended": pid, "code": code})

    def _say(self, answer: Mapping[str, int]) -> None:
        self._control.send(json.dumps(answer).encode())

    def _make(self, runner: str, environment: Mapping[str, str], descriptors: Sequence[int]) -> int:
        """Process id of a new worker, 0 in the worker itself, -errno where the system refuses."""
        try:
            if not is_alone():
                return self._spawn(runner, environment, descriptors)
            pid = fork()
        except OSError as error:
            return -(error.errno or errno.EAGAIN)
        with suppress(OSError):
            os.setpgid(pid, pid)  # whoever comes first, the worker or this
        return pid

    def _become(self, runner: str, environment: Mapping[str, str], descriptors: Sequence[int]) -> list[str]:
        *passed, log = descriptors
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        os.dup2(log, 1)
        os.dup2(log, 2)
        for descriptor in (log, self._woken, self._waking):
            os.close(descriptor)
        self._control.close()
        os.environ.update(environment)
        return [runner, *map(str, passed), str(self._pid)]

    def _spawn(self, runner: str, environment: Mapping[str, str], descriptors: Sequence[int]) -> int:
        import subprocess  # most have one thread, and fork

        *passed, log = descriptors
        words = [sys.executable, "-m", worker.__name__, runner, *map(str, passed), str(self._pid)]
        seen = {**os.environ, **environment, "PYTHONPATH": os.pathsep.join(sys.path)}
        child = subprocess.Popen(words, stdout=log, stderr=log, pass_fds=passed, process_group=0, env=seen)
        child.returncode = 0  # it is looked after here
        return child.pid


def is_alone() -> bool:
    """Whether this process has one thread: a fork takes no other along, but what the others had locked stays locked."""
    try:
        return len(os.listdir("/proc/self/task")) == 1
    except OSError:
        return False


def fork() -> int:
    """As `os.fork`, with nothing in any buffer that both would print."""
    sys.stdout.flush()
    sys.stderr.flush()
    ctypes.CDLL(None).fflush(None)
    return os.fork()


def begin(control: int, parent: int) -> list[str]:
    """Be a nursery that has been started; returns as `Nursery.serve` does.

    Args:
        control: Descriptor of the socket.
        parent: Process id of who started it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    worker.live_with(parent)
    faulthandler.enable()
    os.set_inheritable(control, False)
    return Nursery(socket.socket(fileno=control)).serve()


def begin_forked(control: int, log: int, parent: int) -> None:
    """Be a nursery, in a fork of a process that has opened and begun nothing; does not return.

    Afterwards this process is as one that was started for it: of the other's files, session, command line and module
    search path it has nothing.
    """
    try:
        os.setsid()
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        os.dup2(log, 1)
        os.dup2(log, 2)
        for name in os.listdir("/proc/self/fd"):
            if int(name) > 2 and int(name) != control:
                with suppress(OSError):  # that of the folder is closed already
                    os.close(int(name))
        sys.argv = [__file__]
        sys.modules["__main__"] = sys.modules[__name__]  # for what a rule starts with `multiprocessing`
        failpoints.arm(os.environ.get(failpoints.VARIABLE, ""))  # its visits count from here
        sys.path[:] = dict.fromkeys([os.getcwd(), str(ROOT), *sys.path[1:]])
        worker.main(begin(control, parent))
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


if __name__ == "__main__":
    worker.main(begin(*map(int, sys.argv[1:])))
