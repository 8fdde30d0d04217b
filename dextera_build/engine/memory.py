"""Memory of this process that nobody uses."""

from __future__ import annotations

import ctypes
from contextlib import suppress

_MANY = 10_000
"""Fewer nodes leave too little behind to be worth the time."""
_LARGE = 1 << 18
"""Blocks of this size come from the system one by one [bytes]."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Names of settings in `malloc.h`."""


def give_back(nodes: int) -> None:
    """Hand free memory back to the system during work on so many nodes, where the C library can do that.

    It keeps what lies below a block in use: tables that grow and plans that were read leave holes as large as all that
    the process needs. So free pages go back now, and from now on a large block goes back when it is freed.
    """
    if nodes >= _MANY:
        with suppress(OSError, AttributeError):
            library = ctypes.CDLL(None)
            library.mallopt(_MMAP_THRESHOLD, _LARGE)
            library.mallopt(_TRIM_THRESHOLD, _LARGE)
            library.malloc_trim(0)
