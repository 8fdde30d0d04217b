"""State that a task leaves in its worker: undone if that is sound; otherwise the worker must end after the task.

The next task then finds the state of a new worker, so that no result depends on what ran before it. State
inside of libraries, such as the number of threads that torch uses, is not looked at.
"""

from __future__ import annotations

import contextvars
import locale
import os
import re
import resource
import signal
import sys
import sysconfig
import threading
import time
import traceback
import types
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias, TypeVar

from dextera_build.outside import guard
from dextera_build.workers import family

T = TypeVar("T")
Contents: TypeAlias = tuple[tuple[str, ...], tuple[object, ...]]
"""Names of a module, and their values."""

_PATIENCE_S = 0.1
"""How long threads and processes of a task that has ended may take to end [s]."""
_LIMITS = [number for name, number in vars(resource).items() if name.startswith("RLIMIT_")]
_READ_ONCE = (
    "CUDA_VISIBLE_DEVICES",
    "LANG",
    "LC_ALL",
    "MKL_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "TZ",
)
"""Variables that libraries read when they load, so that restoring them is too late."""
_OF_THREADS = 1 << 31 | 1 << 32
"""Signals 32 and 33, which the C library handles from the first thread of a process on; nobody else can use them."""
_SEEDED = ("random", "numpy.random", "torch")
"""Modules with a random state of the process, as new after their function `seed`."""
_STDLIB, _DXB = sysconfig.get_path("stdlib") + os.sep, str(Path(__file__).parents[1]) + os.sep


class Leftovers:
    """Notes the state of this process when it is made; the tasks of the worker begin in this state."""

    def __init__(self) -> None:
        self._folder = os.getcwd()
        self._umask = _umask()
        self._variables = dict(os.environ)
        self._streams = {name: getattr(sys, name) for name in ("stdin", "stdout", "stderr")}
        self._recursion = sys.getrecursionlimit()
        self._locale = locale.setlocale(locale.LC_ALL)
        self._threads = set(sys._current_frames())
        self._lasting = dict(self._facts())
        self._modules: dict[str, tuple[types.ModuleType, Contents]] = {}
        self._note_modules()

    def apart(self, call: Callable[[], T]) -> T:
        """Call with contexts of its own: decimal, NumPy's errors and printing, filters of warnings."""
        with warnings.catch_warnings():
            return contextvars.copy_context().run(call)

    def clear(self) -> str:
        """Undo reversible changes; returns the remaining one, or ""."""
        left = [name for name, value in self._facts() if self._lasting[name] != value]
        left += [name for name in _READ_ONCE if os.environ.get(name) != self._variables.get(name)]
        left += filter(None, (self._patched(), _settled(self._thread), _settled(_process), self._restore()))
        return ", ".join(left)

    def _facts(self) -> Iterator[tuple[str, object]]:
        """State of the process that a worker cannot take back, or that modules were imported with."""
        yield "module search path", tuple(sys.path)
        yield "output", [(os.fstat(number).st_dev, os.fstat(number).st_ino) for number in (1, 2)]
        with open("/proc/self/status") as status:
            found = re.findall(r"^Sig(?:Blk|Ign|Cgt):\s*(\w+)", status.read(), re.MULTILINE)
        yield "signal handlers", [int(mask, 16) & ~_OF_THREADS for mask in found]
        yield "signal handler", [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        yield "timer", [signal.getitimer(kind)[0] > 0 for kind in (signal.ITIMER_REAL, signal.ITIMER_VIRTUAL)]
        yield "limits", [resource.getrlimit(number) for number in _LIMITS]
        yield "cores and priority", (os.sched_getaffinity(0), os.getpriority(os.PRIO_PROCESS, 0))
        yield "open files", len(os.listdir("/proc/self/fd")) > resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 2

    def _restore(self) -> str:
        os.umask(self._umask)
        sys.setrecursionlimit(self._recursion)
        vars(sys).update(self._streams)
        if dict(os.environ) != self._variables:
            os.environ.clear()
            os.environ.update(self._variables)
        for name in _SEEDED:
            if (module := sys.modules.get(name)) is not None:
                module.seed()
        try:
            locale.setlocale(locale.LC_ALL, self._locale)
            os.chdir(self._folder)
        except (OSError, locale.Error) as error:
            return str(error)
        return ""

    def _patched(self) -> str:
        """A module in which a function or a class was replaced; packages may do that when they load."""
        for name, (module, before) in list(self._modules.items()):
            if sys.modules.get(name) is not module or _begins_with(vars(module), before):
                continue
            for word, value in zip(*before, strict=True):
                found = vars(module).get(word)
                if callable(value) and found is not value and not _is_of_package(_file(found)):
                    return f"{name}.{word}"
            self._modules[name] = module, _contents(module)
        return self._note_modules()

    def _note_modules(self) -> str:
        """Note modules that were loaded since; returns a foreign one that holds a function of the project, or ""."""
        for name, module in list(sys.modules.items()):
            if name in self._modules or type(module) is not types.ModuleType:
                continue
            self._modules[name] = module, _contents(module)
            if not _is_own(getattr(module, "__file__", None) or ""):
                for word, value in vars(module).items():
                    if _is_own(_file(value)):
                        return f"{name}.{word}"
        return ""

    def _thread(self) -> str:
        """A new thread that runs other code than that of a package, which may keep threads as it keeps other state."""
        for number, frame in sys._current_frames().items():
            if number not in self._threads:
                files = [inner.f_code.co_filename for inner, _ in traceback.walk_stack(frame)]
                first = next((file for file in reversed(files) if file != threading.__file__), "")
                if not _is_of_package(first):
                    return "a thread"
        return ""


def _process() -> str:
    """A child process that is neither a program's guard nor Python's own."""
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return ""
    tracker = sys.modules.get("multiprocessing.resource_tracker")
    own = tracker and tracker._resource_tracker._pid
    return "a process" if set(family.strangers(guard.below(os.getpid()))) - {own} else ""


def _settled(look: Callable[[], str]) -> str:
    """Result of `look`, unless it becomes empty within a short time."""
    deadline = time.monotonic() + _PATIENCE_S
    while (found := look()) and time.monotonic() < deadline:
        time.sleep(0.005)
    return found


def _umask() -> int:
    now = os.umask(0o022)
    os.umask(now)
    return now


def _contents(module: types.ModuleType) -> Contents:
    return tuple(vars(module)), tuple(vars(module).values())


def _begins_with(now: dict[str, object], before: Contents) -> bool:
    """Whether all values are the same, but for later ones."""
    try:
        return tuple(now.values())[: len(before[1])] == before[1]  # compares by identity first, so it is quick
    except Exception:  # values that are not the same may refuse to be compared
        return False


def _file(value: object) -> str:
    """Where a function was defined; "" for anything else."""
    return value.__code__.co_filename if type(value) is types.FunctionType else ""


def _is_own(file: str) -> bool:
    """Whether a file is code of the project."""
    return os.path.isabs(file) and not _is_of_package(file) and not file.startswith(_STDLIB)


def _is_of_package(file: str) -> bool:
    return file.startswith(_DXB) or not {"site-packages", "dist-packages"}.isdisjoint(file.split(os.sep))
