"""Recorded calls of services: sent once, then answered from the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Response:
    """The answer of a service; only its body is part of results."""

    body: bytes
    status: int = 200
    """HTTP status, or its equivalent: 429 and 5xx are retried, other 4xx are refusals."""
    headers: Mapping[str, str] = field(default_factory=dict)
    """`Retry-After` is honoured; the others are ignored."""
