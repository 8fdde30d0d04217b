"""A process that has loaded what workers need, and makes workers: each is a fork of it.

    python -m dextera_build.engine.nursery <module:function> <descriptor of a socket> <process id>

So a worker costs a few milliseconds, where an interpreter that starts and imports costs a few hundred. Nothing of a
project is loaded here, no rule, no numpy and nothing that starts threads: what a worker makes of itself no other sees.

Each message of the socket is JSON: first `{"path": [...]}`, the pool's module search path; then `{"environment":
{...}}`, with the descriptors of tasks, file, replies and log, asks for a worker, and `{"look": pid}` for what became
of one. Each is answered, in their order: `{"pid": ...}` or `{"refused": errno}`; `{"look": pid, "status": ...}`, null
while it runs. It ends when the socket closes and when its parent dies, and its workers with it.
"""

from __future__ import annotations

import ctypes
import errno
import faulthandler
import gc
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress

from dextera_build.engine import worker

MESSAGE = 1 << 20
"""No message takes more [bytes]."""


class Nursery:
    """Answers until the socket closes.

    Args:
        runner: `module:function` for the workers.
        control: The socket.
    """

    def __init__(self, runner: str, control: socket.socket) -> None:
        self._runner = runner
        self._control = control
        self._pid = os.getpid()
        self._ended: dict[int, int] = {}

    def serve(self) -> list[str]:
        """Load what workers need, then make them; returns in each fork, with the arguments of the worker to be."""
        told = json.loads(self._control.recv(MESSAGE))
        sys.path += [entry for entry in told["path"] if entry not in sys.path]
        with suppress(Exception):  # the worker says what is wrong, to whoever gives it a task
            worker.load(self._runner)
        # What is here stays: no worker need look at it again, and so copy its pages.
        gc.freeze()
        while True:
            data, descriptors, _, _ = socket.recv_fds(self._control, MESSAGE, 4, socket.MSG_CMSG_CLOEXEC)
            if not data:
                os._exit(0)
            message = json.loads(data)
            if "look" in message:
                answer: Mapping[str, int | None] = self._look(message["look"])
            elif (pid := self._make(message["environment"], descriptors)) == 0:
                return self._become(message["environment"], descriptors)
            else:
                answer = {"pid": pid} if pid > 0 else {"refused": -pid}
            for descriptor in descriptors:
                os.close(descriptor)
            self._control.send(json.dumps(answer).encode())

    def _make(self, environment: Mapping[str, str], descriptors: Sequence[int]) -> int:
        """Process id of a new worker, 0 in the worker itself, -errno where the system refuses."""
        try:
            # A fork takes along this thread alone, with whatever locks the others held.
            if len(os.listdir("/proc/self/task")) > 1:
                return self._spawn(environment, descriptors)
            sys.stdout.flush()
            sys.stderr.flush()
            ctypes.CDLL(None).fflush(None)
            pid = os.fork()
        except OSError as error:
            return -(error.errno or errno.EAGAIN)
        with suppress(OSError):
            os.setpgid(pid, pid)  # whoever comes first, the worker or this
        return pid

    def _become(self, environment: Mapping[str, str], descriptors: Sequence[int]) -> list[str]:
        *passed, log = descriptors
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
        self._control.close()
        os.environ.update(environment)
        return [self._runner, *map(str, passed), str(self._pid)]

    def _spawn(self, environment: Mapping[str, str], descriptors: Sequence[int]) -> int:
        *passed, log = descriptors
        words = [sys.executable, "-m", worker.__name__, self._runner, *map(str, passed), str(self._pid)]
        seen = {**os.environ, **environment, "PYTHONPATH": os.pathsep.join(sys.path)}
        child = subprocess.Popen(words, stdout=log, stderr=log, pass_fds=passed, process_group=0, env=seen)
        child.returncode = 0  # it is looked after here
        return child.pid

    def _look(self, pid: int) -> dict[str, int | None]:
        if pid not in self._ended:
            found, status = os.waitpid(pid, os.WNOHANG)
            if found:
                self._ended[pid] = status
        return {"look": pid, "status": self._ended.get(pid)}


def main(arguments: list[str]) -> list[str]:
    """Entry point; see the module's text. Returns in a fork, as `Nursery.serve` does."""
    runner, descriptor, parent = arguments[0], *map(int, arguments[1:])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    worker.live_with(parent)
    faulthandler.enable()
    control = socket.socket(fileno=descriptor)
    control.set_inheritable(False)
    return Nursery(runner, control).serve()


if __name__ == "__main__":
    worker.main(main(sys.argv[1:]))
