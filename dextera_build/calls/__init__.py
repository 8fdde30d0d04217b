"""Recorded calls of services: sent once, then answered from the store."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol, TypedDict, runtime_checkable


@dataclass(frozen=True)
class Response:
    """The answer of a service; only its body is part of results."""

    body: bytes
    status: int = 200
    """HTTP status, or its equivalent: 429 and 5xx are retried, other 4xx are refusals."""
    headers: Mapping[str, str] = field(default_factory=dict)
    """`Retry-After` is honoured; the others are ignored."""


@dataclass(frozen=True)
class JobState:
    """State of a job, as reported by its service."""

    state: Literal["waits", "runs", "done", "failed"]
    said: str = ""
    """Why it failed, in the service's words."""
    done: float = 0.0
    """Fraction that is done, if the service reports it."""


@runtime_checkable
class Job(Protocol):
    """The client of a service that works on a request for minutes: submit, poll, fetch.

    Each method sends one request, waits at most `timeout_s` [s], and returns its answer, or the `Response` of a service
    that answers with an HTTP status other than 2xx. `OSError`, httpx's transport errors, 429 and 5xx are retried.
    """

    def submit(self, timeout_s: float) -> str | Response:
        """Hand in the request; returns the service's name for the job."""
        ...

    def poll(self, name: str, timeout_s: float) -> JobState | Response:
        """How far the job is. The status 404 means that the service does not know the job (any more)."""
        ...

    def fetch(self, name: str, timeout_s: float) -> bytes | Response:
        """The answer of a job that is done."""
        ...

    def cancel(self, name: str, timeout_s: float) -> bool:
        """End the job; False if the service cannot."""
        ...


class CallManner(TypedDict, total=False):
    """The keywords of `Context.call`."""

    valid: Callable[[bytes], object] | None
    """Raises `ValueError` or a `RuleError` for a body that is not an answer; it is not recorded."""
    data: tuple[str, ...]
    """Kinds of the user's data in the request, such as `mesh`, which are sent only with the user's consent. A picture
    counts as a `photograph`, named or not."""
    repair: Callable[[bytes, str], Callable[[float], bytes | Response]] | None
    """For `call`: an unusable body and the reason -> the sender of a request for a better one."""
    repairs: int
    """Most repairs, 2 unless given. With `repair`, an unusable body is not requested in any other way."""
    timeout_s: float
    """Timeout of each request [s], 60 unless given."""
    tries: int
    """Maximum number of tries of each request, 4 unless given."""
    wait_s: float
    """Delay before the second try [s], doubled before each further one, 1 unless given; `Retry-After` takes
    precedence."""
    secrets: tuple[str, ...]
    """Texts that must not occur in the request or the answer, in addition to the values of variables such as
    `SERVICE_API_KEY`."""


class JobManner(CallManner, total=False):
    """The keywords of `Context.job`."""

    poll_s: float
    """Interval of polling the state of the job [s], 5 unless given."""
    limit_s: float
    """Longest wait for the job [s], 3600 unless given. A longer job is not cancelled; the next build waits again."""
