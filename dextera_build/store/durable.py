"""Making what a build wrote survive a power cut, with one call to the system however many files there are.

No file is flushed by itself. Until the call ends a power cut may drop, shorten or empty any file of the run; every one
of them is believed only after its size or digest was checked, so that costs time and never a wrong result.
"""

from __future__ import annotations

import ctypes
import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any


def settle(folder: Path) -> bool:
    """Wait until all that was written to the file system of `folder` is on its disk; whether the system says it is."""
    call = _syncfs()
    if call is None:
        os.sync()
        return True
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            return bool(call(descriptor) == 0)
        finally:
            os.close(descriptor)
    return False


@cache
def _syncfs() -> Any:
    """`syncfs` of the C library, None where there is none; unlike `sync` it leaves other disks alone."""
    try:
        return ctypes.CDLL(None, use_errno=True).syncfs
    except (OSError, AttributeError):
        return None
