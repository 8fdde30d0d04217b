"""The interface of executors, which take tasks and report their outcomes.

The scheduler knows nothing else about how nodes run; an executor can be a process pool, this process, or a cluster.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol, TypeAlias

from dextera_build.errors import DxbError, Place, RuleError
from dextera_build.redact import redact_plain
from dextera_build.workers.capacity import Capacity, Needs

_LITTLE = Needs()
_OWN = ("ticket", "needs")
"""Fields of a task that are not sent to its runner."""
_LOG_MOST = 1 << 20
"""Only this much of the end of a log is kept [bytes]."""
_TOLD = ("line", "previews", "metrics")
"""Fields of a reply that hold texts of the rule."""

_TEXT_MOST = 1000
"""Only this much of the text of an exception is in the error [characters]."""


@dataclass(frozen=True)
class Task:
    """One run of a rule, identified by `ticket`; contains only names and digests."""

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
    """GPUs that it may use, by their names in `CUDA_VISIBLE_DEVICES`."""
    key: str = ""
    """Name of the folder for the call's saved progress; "" for a fresh one."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """`RuleFacts.sources`."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """Distribution -> version, as in the key."""
    weights: tuple[str, ...] = ()
    """`name@digest`, as in the key."""
    program: Mapping[str, str] = field(default_factory=dict)
    """`RuleFacts.program`."""
    companions: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """`RuleFacts.companions`."""

    def message(self) -> dict[str, object]:
        """The fields that are passed to the runner."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in _OWN}


@dataclass(frozen=True)
class Said:
    """A message of a running task: `progress`, `log` or `read`."""

    ticket: int
    kind: str
    data: Mapping[str, Any]


@dataclass(frozen=True)
class Ended:
    """The end of a task, with a reply or an error."""

    ticket: int
    seconds: float
    log: bytes
    """Its output; only the end of a long one."""
    reply: Mapping[str, Any] | None = None
    """{"output", "line", "previews", "metrics"}."""
    error: DxbError | None = None
    raised: tuple[str, ...] = ()
    """Names of the exception that escaped the rule and of its bases."""
    usage: Mapping[str, float] = field(default_factory=dict)
    """`cpu_seconds`, `memory_bytes` (peak), `read_bytes` and `written_bytes` (by read and write calls, cached or not).

    Values that the system does not report are left out.
    """


Report: TypeAlias = Said | Ended


def redacted(report: Report) -> Report:
    """A report without the secrets that this process knows; all output of a node passes here."""
    if isinstance(report, Said):
        return report if report.kind == "read" else replace(report, data=redact_plain(dict(report.data)))
    return replace(report, log=redact_plain(report.log), reply=redacted_reply(report.reply))


def redacted_reply(reply: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """A reply without secrets in its texts; digests stay."""
    if reply is None:
        return None
    return {name: redact_plain(value) if name in _TOLD else value for name, value in reply.items()}


class Executor(Protocol):
    """Runs tasks."""

    @property
    def capacity(self) -> Capacity:
        """Resources shared by tasks; submitted tasks never exceed them."""
        ...

    def submit(self, task: Task) -> None:
        """Start `task`."""
        ...

    def poll(self, timeout_s: float | None) -> list[Report]:
        """New reports; waits at most `timeout_s` [s] for the first one, without limit if None."""
        ...

    def stop(self) -> None:
        """End all running tasks at once; they are never reported."""
        ...


def printed(descriptor: int) -> bytes:
    """The output of a task in this file; only the end of a long one."""
    size = os.fstat(descriptor).st_size
    return os.pread(descriptor, _LOG_MOST, max(0, size - _LOG_MOST)) if size else b""


def escaped(error: BaseException, project: str = "") -> RuleError:
    """The error for an exception that escaped a rule; its traceback belongs in the node's log.

    Args:
        error: The exception.
        project: The project folder; the error names the innermost line of its code in the traceback.
    """
    text = f"{type(error).__name__}: {error}".strip().rstrip(":").splitlines()[0]
    text = text if len(text) <= _TEXT_MOST else f"{text[:_TEXT_MOST]}..."
    where = _last_line(error, project) if project else None
    return RuleError(text, code="DXB-B302", where=where, hint="`dxb log` shows the whole traceback")


def _last_line(error: BaseException, project: str) -> Place | None:
    """The innermost frame of an exception in the project's own code, excluding packages installed inside it."""
    import traceback

    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = frame.f_code.co_filename
        if file.startswith(project + os.sep) and "site-packages" not in file:
            found = Place(os.path.relpath(file, project), line)
    return found
