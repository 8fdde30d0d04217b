"""A clock that is wrong."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def clock(offset_s: float) -> Iterator[None]:
    """Let this process believe that it is so much later [s]; the clock of the file system stays."""
    real, real_ns = time.time, time.time_ns
    time.time, time.time_ns = lambda: real() + offset_s, lambda: real_ns() + int(offset_s * 1e9)
    try:
        yield
    finally:
        time.time, time.time_ns = real, real_ns
