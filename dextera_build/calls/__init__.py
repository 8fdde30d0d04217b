"""Recorded calls of services: asked once, then answered from the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Response:
    """What a service answered; only its body is part of results."""

    body: bytes
    status: int = 200
    """HTTP status, or what corresponds to it: 429 and 5xx are asked again, other 4xx are refusals."""
    headers: Mapping[str, str] = field(default_factory=dict)
    """`Retry-After` is honoured; the others are ignored."""
