"""What an executor is: it takes tasks and reports what becomes of them.

The scheduler knows nothing else about how nodes run, so a pool of processes, this very process, or a cluster fit alike.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeAlias

from dextera_build.errors import DxbError, Place, RuleError
from dextera_build.workers.capacity import Capacity, Needs

_LITTLE = Needs()
_TOLD = ("rule", "backend", "options", "inputs", "store", "project", "profile", "key", "sources", "packages")
"""Fields of a task that its runner gets."""
_LOG_MOST = 1 << 20
"""A longer log is kept from its end [bytes]."""


@dataclass(frozen=True)
class Task:
    """One run of a rule, named by `ticket`. Only names and digests travel."""

    ticket: int
    rule: str
    backend: str | None
    options: Mapping[str, object]
    inputs: Mapping[str, str]
    """Slot -> digest of the artifact."""
    store: str
    project: str
    profile: str
    needs: Needs = _LITTLE
    devices: tuple[str, ...] = ()
    """GPUs that it may use, as `CUDA_VISIBLE_DEVICES` calls them."""
    key: str = ""
    """Names the folder in which the call keeps its progress; "" where it shall have a fresh one."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """`RuleFacts.sources`."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Distribution -> version, as the key holds them."""

    def message(self) -> dict[str, object]:
        """What the runner gets."""
        return {name: getattr(self, name) for name in _TOLD}


@dataclass(frozen=True)
class Said:
    """A running task emitted something: `progress` or `log`."""

    ticket: int
    kind: str
    data: Mapping[str, Any]


@dataclass(frozen=True)
class Ended:
    """A task is over: with a reply, or with an error."""

    ticket: int
    seconds: float
    log: bytes
    """What it printed; the end of it where that is long."""
    reply: Mapping[str, Any] | None = None
    """{"output", "line", "previews", "metrics"}."""
    error: DxbError | None = None
    raised: tuple[str, ...] = ()
    """The exception that the rule let escape, with its bases."""
    usage: Mapping[str, float] = field(default_factory=dict)
    """`cpu_seconds`, `memory_bytes` (peak), `read_bytes` and `written_bytes` (by read and write calls, cached or not).

    A number that the system does not give is left out.
    """


Report: TypeAlias = Said | Ended


class Executor(Protocol):
    """Runs tasks."""

    @property
    def capacity(self) -> Capacity:
        """What tasks share; no more are submitted at a time than it holds."""
        ...

    def submit(self, task: Task) -> None:
        """Start `task`."""
        ...

    def poll(self, timeout_s: float | None) -> list[Report]:
        """What happened; waits at most `timeout_s` [s] for the first report, None for as long as it takes."""
        ...

    def stop(self) -> None:
        """End everything that runs, at once; what was running is never reported."""
        ...


def printed(descriptor: int) -> bytes:
    """What a task printed to this file; the end of it where that is long."""
    size = os.fstat(descriptor).st_size
    return os.pread(descriptor, _LOG_MOST, max(0, size - _LOG_MOST)) if size else b""


def escaped(error: BaseException, project: str = "") -> RuleError:
    """What an exception that a rule let escape means for the build; its traceback belongs into the node's log.

    Args:
        error: The exception.
        project: The project's folder; the last line of its code that the exception passed is named.
    """
    text = f"{type(error).__name__}: {error}".strip().rstrip(":")
    where = _last_line(error, project) if project else None
    return RuleError(text.splitlines()[0], code="DXB-B302", where=where, hint="`dxb log` shows the whole traceback")


def _last_line(error: BaseException, project: str) -> Place | None:
    """The innermost frame of an exception in a file of the project, where packages may be installed as well."""
    import traceback

    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = frame.f_code.co_filename
        if file.startswith(project + os.sep) and "site-packages" not in file:
            found = Place(os.path.relpath(file, project), line)
    return found
