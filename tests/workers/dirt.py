"""Tasks that leave something behind in their worker, and one that looks at what it finds."""

from __future__ import annotations

import decimal
import locale
import os
import random
import resource
import signal
import sys
import textwrap
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_KEPT: list[object] = []


def run_task(task: Mapping[str, Any], emit: Callable[[str, Any], None]) -> dict[str, Any]:
    """Carry out one of `DIRT`, or look."""
    do = task["options"]["do"]
    if do in DIRT:
        DIRT[do]()
        return {}
    return {"pid": os.getpid(), "drawn": [random.random(), float(np.random.random())], "state": repr(_state())}


def _state() -> dict[str, object]:
    mask = os.umask(0)
    os.umask(mask)
    return {
        "folder": os.getcwd(),
        "mask": mask,
        "variables": {name: value for name, value in os.environ.items() if not name.startswith(("DEXTERA", "PYTEST"))},
        "decimals": decimal.Decimal(1) / 3,
        "numbers": (np.array([2 / 3]), np.geterr(), locale.setlocale(locale.LC_ALL)),
        "dedent": textwrap.dedent(" a"),
        "warnings": warnings.filters,
        "path": sys.path,
        "recursion": sys.getrecursionlimit(),
        "cores": (os.sched_getaffinity(0), os.getpriority(os.PRIO_PROCESS, 0)),
        "signals": (signal.getsignal(signal.SIGTERM).__name__, signal.getsignal(signal.SIGUSR1), signal.alarm(0)),
        "limits": resource.getrlimit(resource.RLIMIT_FSIZE),
        "threads": threading.active_count(),
        "output": (sys.stdout is sys.__stdout__, os.fstat(1).st_size),
        "open": len(os.listdir("/proc/self/fd")) < 50,
        "children": Path(f"/proc/self/task/{os.getpid()}/children").read_text(),
    }


def _open_files() -> None:
    _KEPT.extend(
        os.open(os.devnull, os.O_RDONLY) for _ in range(resource.getrlimit(resource.RLIMIT_NOFILE)[0] * 2 // 3)
    )


def _talk() -> None:
    def say() -> None:
        while True:
            print("still here", flush=True)
            time.sleep(0.001)

    threading.Thread(target=say, daemon=True).start()


def _leave_a_daemon() -> None:
    if not os.fork():
        os.setsid()
        if not os.fork():
            os.execlp("sleep", "sleep", "60")
        os._exit(0)
    os.wait()


def _patch_what_was_loaded() -> None:
    textwrap.dedent = lambda text: "patched"  # type: ignore[assignment,misc]


def _patch_what_is_loaded_now() -> None:
    import colorsys

    colorsys.rgb_to_hls = lambda *rgb: (0, 0, 0)  # type: ignore[assignment,misc]


def _print_elsewhere() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


DIRT: Mapping[str, Callable[[], object]] = {
    "folder": lambda: os.chdir("/"),
    "variable": lambda: os.environ.update(LABX="7"),
    "variable of a library": lambda: os.environ.update(OMP_NUM_THREADS="7"),
    "mask": lambda: os.umask(0o777),
    "decimal context": lambda: setattr(decimal.getcontext(), "prec", 5),
    "print options": lambda: np.set_printoptions(precision=2),
    "floating-point errors": lambda: np.seterr(all="raise"),
    "random state": lambda: (random.seed(1), np.random.seed(1)),
    "locale": lambda: locale.setlocale(locale.LC_ALL, "POSIX"),
    "filters of warnings": lambda: warnings.simplefilter("error"),
    "recursion limit": lambda: sys.setrecursionlimit(5_000),
    "stdout": lambda: setattr(sys, "stdout", None),
    "output": _print_elsewhere,
    "patch of a loaded module": _patch_what_was_loaded,
    "patch of a new module": _patch_what_is_loaded_now,
    "search path": lambda: sys.path.insert(0, "/first"),
    "cores": lambda: os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}),
    "niceness": lambda: os.nice(1),
    "open files": _open_files,
    "limit": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30)),
    "signal handler": lambda: signal.signal(signal.SIGUSR1, signal.SIG_IGN),
    "timer": lambda: signal.alarm(60),
    "thread": _talk,
    "daemon": _leave_a_daemon,
}
