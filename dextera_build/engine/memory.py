"""Memory of this process that nobody uses, and how it comes back to the system."""

from __future__ import annotations

import ctypes
import gc
from contextlib import suppress

_MANY = 10_000
"""Fewer nodes leave too little behind to be worth the time."""
_LARGE = 1 << 18
"""Blocks of this size come from the system one by one [bytes]."""
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Names of settings in `malloc.h`."""


def hold_large_apart() -> None:
    """From now on let a large block go back when it is freed, where the C library can do that.

    It does so by itself until the first is freed; later ones lie among small ones, and tables that grow leave holes
    there as large as all that a build of many nodes needs.
    """
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, _LARGE)
        library.mallopt(_TRIM_THRESHOLD, _LARGE)


def give_back(nodes: int) -> None:
    """Hand back what work on so many nodes left behind: also what refers to itself, and pages below a block in use."""
    if nodes >= _MANY:
        gc.collect()
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
