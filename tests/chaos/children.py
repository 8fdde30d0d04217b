"""The command line in children of the test process: what a new process of `dxb` does, without its start-up time.

Nodes run in the child itself, so that a failpoint anywhere in a build is reached in one process.
"""

from __future__ import annotations

import importlib
import itertools
import os
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from dextera_build.cli.main import main
from dextera_build.running.runner import run_task
from dextera_build.store import failpoints
from dextera_build.workers import pool
from tests.engine.inline import InlineExecutor

for _name in (
    "cli.build.build",
    "cli.share.cache",
    "cli.build.check",
    "building.build",
    "building.export",
):
    importlib.import_module(f"dextera_build.{_name}")  # here, once, rather than in every child
for _name in ("numpy", "pydantic", "dextera_build.engine.run", "dextera_build.recipe.plan"):
    importlib.import_module(_name)


_COUNT = itertools.count()


@dataclass(frozen=True)
class Said:
    """How a child ended."""

    code: int
    """Exit code; the negative number of the signal that ended it."""
    text: str
    """What it printed."""


Workers = pool.LocalExecutor
"""What runs nodes in processes of their own."""


class _Inline(InlineExecutor):
    def __init__(self, runner: str, *settings: object) -> None:
        super().__init__(run_task)

    def warm(self) -> None:
        """There is no process that could be started early."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()


def dxb(root: Path, *words: str, failpoint: str = "", begin: Callable[[], object] = lambda: None) -> Said:
    """Run one command in the project at `root`.

    Args:
        root: The project's folder.
        words: The command line.
        failpoint: As `DXB_FAILPOINT` has it.
        begin: Called in the child before the command.
    """
    return start(root, *words, failpoint=failpoint, begin=begin)()


def start(
    root: Path, *words: str, failpoint: str = "", begin: Callable[[], object] = lambda: None
) -> Callable[[], Said]:
    """Begin what `dxb` does; call what is returned to wait for its end."""
    printed = root.with_name(f".printed{next(_COUNT)}")  # a new file in the project would count
    pid = os.fork()
    if pid == 0:
        _become(root, words, failpoint, printed, begin)
    return lambda: _end(pid, printed)


def _end(pid: int, printed: Path) -> Said:
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    text = printed.read_text()
    printed.unlink()
    return Said(code, text)


def _become(root: Path, words: tuple[str, ...], failpoint: str, printed: Path, begin: Callable[[], object]) -> None:
    code = 99
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        output = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        os.chdir(root)
        for name in [name for name in os.environ if name.startswith("DXB_")]:
            del os.environ[name]
        os.environ |= {"NO_COLOR": "1", "DXB_DURABLE": "0", "DXB_CONSOLE": "plain"}
        os.environ |= {"XDG_CONFIG_HOME": str(root / ".config"), "XDG_CACHE_HOME": str(root / ".cache")}
        pool.LocalExecutor = _Inline  # type: ignore[misc,assignment]
        failpoints.arm(failpoint)
        begin()
        code = main(words)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
