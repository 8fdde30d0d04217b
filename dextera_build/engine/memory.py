"""Memory of this process that nobody uses."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_MANY = 10_000
"""Fewer nodes leave too little behind to be worth the time."""


def give_back(nodes: int) -> None:
    """Hand free memory back to the system after work on so many nodes, where the C library can do that.

    It keeps what lies below a block in use, and of a large plan that is a third of all that the process holds.
    """
    if nodes >= _MANY:
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
