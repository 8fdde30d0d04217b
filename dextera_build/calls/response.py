"""What a service answered to a recorded call."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Response:
    """An answer as it came; only its body is part of results."""

    body: bytes
    status: int = 200
    """HTTP status, or what corresponds to it: 429 and 5xx are asked again, other 4xx are refusals."""
    headers: Mapping[str, str] = field(default_factory=dict)
    """`Retry-After` is honoured; the others are not looked at."""
