"""A trainer of another project, run as its command line: its output is followed, and its end is explained.

Part of programs, so it needs the standard library alone.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections import deque
from collections.abc import Callable, Mapping, Sequence

import dxb_backend  # type: ignore[import-not-found]

_TOLD = 6
"""Last lines of a failed trainer that are told."""
_MOST = 900
"""Longest message of a refusal."""
MEMORY = ("out of memory", "outofmemory", "defaultcpuallocator", "resource_exhausted", "cannot allocate memory")
SMALLER = "a smaller `batch`, a smaller network, adapters instead of all weights, or a larger GPU"


def follow(name: str, command: Sequence[str], read: Callable[[str], None], cwd: str, **more: str) -> None:
    """Run a trainer until it ends.

    Args:
        name: What it is called in messages.
        command: Its command line.
        read: Takes each line that it prints; a refusal of it ends the trainer.
        cwd: Folder that it starts in.
        more: Environment variables in addition to those of this process.

    Raises:
        Refused: It failed; the message holds its last lines.
    """
    print("$", " ".join(command), flush=True)
    environment: Mapping[str, str] = {**os.environ, **more}
    process = subprocess.Popen(
        command,
        cwd=cwd,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )
    last: deque[str] = deque(maxlen=_TOLD)
    try:
        for line in process.stdout or ():  # carriage returns of progress bars end lines, too
            if not line.strip():
                continue
            if "%|" not in line:
                print(line, end="", flush=True)
                last.append(line.strip())
            read(line)
        code = process.wait()
    finally:
        _end(process)
    if code:
        raise _failed(name, code, list(last))


def not_finite(name: str, steps: int) -> dxb_backend.Refused:
    """The refusal of a loss that is NaN or infinite."""
    hint = "a smaller learning rate; a feature of the data set that hardly varies may be divided by its range"
    return dxb_backend.Refused(f"the loss of {name} is not a number after {steps:,} steps", hint)


def _end(process: subprocess.Popen[str]) -> None:
    """End it with the processes that read its data."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _failed(name: str, code: int, last: list[str]) -> dxb_backend.Refused:
    said = "\n".join(last)
    if code == -signal.SIGKILL or any(word in said.lower() for word in MEMORY):
        return dxb_backend.Refused(
            f"{name} ran out of memory: {last[-1] if last else 'it was killed'}"[:_MOST], SMALLER
        )
    how = f"signal {-code}" if code < 0 else f"exit code {code}"
    hint = "`dxb log` shows all that it printed"
    if "ModuleNotFoundError" in said:
        hint = f"install the package in the environment of {name}, and write its lock file again"
    return dxb_backend.Refused(f"{name} failed ({how}):\n{said[-_MOST:]}"[: _MOST + 90], hint)
