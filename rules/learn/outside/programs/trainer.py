"""A trainer of another project, run as its command line: its output is followed, and its end is explained.

Part of programs, so it needs the standard library alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import re
import signal
import subprocess
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_KEPT, _TOLD = 60, 5
"""Last lines of a trainer that are searched for a cause, and those of them that are told."""
_CAUSE = re.compile(r"^(\[rank\d+\]: ?)?[\w.]*(Error|Exception)\b")
_MOST = 900
"""Longest message of a refusal."""
MEMORY = ("out of memory", "outofmemory", "defaultcpuallocator", "resource_exhausted", "cannot allocate memory")
LOGGED = "`dxb log` shows everything that it printed"
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
    last: deque[str] = deque(maxlen=_KEPT)
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


def answer(request: Any, files: Path, points: Sequence[tuple[int, float]], **facts: str) -> Any:
    """The answer of a training.

    Args:
        request: The request.
        files: A folder of the response, with what was trained.
        points: Steps and losses.
        facts: What is known of the training.
    """
    import numpy as np

    np.save(request.file("steps.npy"), np.array([step for step, _ in points], np.int64))
    np.save(request.file("curve.npy"), np.array([loss for _, loss in points], np.float32))
    return dxb_backend.value(
        "Trained",
        files=dxb_backend.value("Folder", file=files),
        steps=dxb_backend.value("array", file=request.file("steps.npy")),
        curve=dxb_backend.value("array", file=request.file("curve.npy")),
        facts=dxb_backend.items(facts),
    )


def clone(package: str, script: str, where: str) -> Path:
    """The clone of a repository whose package the environment has, installed with `pip install -e`.

    Raises:
        Refused: There is none, or it has no such script.
    """
    found = importlib.util.find_spec(package)
    if found is None or not found.submodule_search_locations:
        hint = f"`git clone {where}`, and `pip install -e` it in the environment"
        raise dxb_backend.Refused(f"the environment has no package `{package}`", hint)
    for folder in Path(found.submodule_search_locations[0]).resolve().parents:
        if (folder / script).is_file():
            return folder
    hint = f"`pip install -e` a clone of {where}, so that its scripts are beside the package"
    raise dxb_backend.Refused(f"there is no `{script}` beside the package `{package}`", hint)


def revision(package: str) -> str:
    """The commit of a clone, `0` without git, with `+` if files of it were edited."""
    found = importlib.util.find_spec(package)
    folder = str(Path(str(found.origin)).parent) if found is not None else "."

    def said(*words: str) -> str:
        done = subprocess.run(["git", "-C", folder, *words], capture_output=True, text=True, check=False)
        return done.stdout.strip() if not done.returncode else ""

    with contextlib.suppress(FileNotFoundError):  # there is no git
        return (said("rev-parse", "HEAD") or "0") + ("+" if said("status", "--porcelain", "-uno") else "")
    return "0"


def digest_of(folder: Path) -> str:
    """Digest of names and contents of all files of a model, which may be larger than memory."""
    state = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and ".cache" not in path.parts):
        own = hashlib.sha256()
        with path.open("rb") as opened:
            for part in iter(lambda: opened.read(1 << 20), b""):
                own.update(part)
        state.update(f"{path.relative_to(folder).as_posix()} {own.hexdigest()}\n".encode())
    return state.hexdigest()


def _end(process: subprocess.Popen[str]) -> None:
    """End it with the processes that read its data."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _failed(name: str, code: int, last: list[str]) -> dxb_backend.Refused:
    told = last[-_TOLD:]
    causes = [line for line in last if _CAUSE.match(line) and "ChildFailedError" not in line]
    if causes and causes[-1] not in told:
        told = [causes[-1], *told]
    memory = [line for line in last if any(word in line.lower() for word in MEMORY)]
    if memory or code == -signal.SIGKILL:
        return dxb_backend.Refused(f"{name} ran out of memory: {(memory or ['it was killed'])[-1]}"[:_MOST], SMALLER)
    how = f"signal {-code}" if code < 0 else f"exit code {code}"
    hint = LOGGED
    if any("ModuleNotFoundError" in line for line in told):
        hint = f"install the package in the environment of {name}, and write its lock file again"
    said = "\n".join(line[:160] for line in told)
    return dxb_backend.Refused(f"{name} failed ({how}):\n{said}"[:_MOST], hint)
