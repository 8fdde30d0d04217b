"""Recognizes errors of full disks, and reports which disk is full, how full it is, and what to do."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dextera_build.errors import StoreError

FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error numbers for a full disk, an exceeded quota and a file at its size limit."""

_WORDS = ("No space left on device", "Disk quota exceeded")
_NEARLY = 1 << 20
"""Free space [bytes] below which a failed write is blamed on the disk."""
_HINTS = {
    "store": "`dxb cache size` shows the size of the store; free space there, or set `DXB_CACHE` to a larger disk",
    "scratch": "free space there, or set `TMPDIR` to a folder on a larger disk",
}


def explain(error: BaseException, store: Path, scratch: Path) -> StoreError | None:
    """Return the error to show if `error` came from a full disk, else None.

    Libraries wrap or drop the system's error (`4096 requested and 0 written`), so its text and the free space count,
    too.

    Args:
        error: The exception that a rule raised.
        store: Folder of the store.
        scratch: Folder for temporary files.
    """
    places = {"store": store, "scratch": scratch}
    found = next((one for one in _chain(error) if _says_full(one)), None)
    if found is None and not (_is_foreign(error) and any(free_bytes(place) < _NEARLY for place in places.values())):
        return None
    file = getattr(found, "filename", None)
    tight = min(places, key=lambda name: (not _holds(places[name], file), free_bytes(places[name])))
    facts = {"file": str(file)} if file else {}
    facts |= {"it says": str(found or error).splitlines()[0]} if str(found or error) else {}
    facts |= {f"free in {name}": f"{free_bytes(place) / 2**20:,.0f} MiB ({place})" for name, place in places.items()}
    return StoreError("the disk is full", code="DXB-S106", facts=facts, hint=_HINTS[tight])


def free_bytes(path: Path | str) -> int:
    """Free space on the disk of a path [bytes]; the path need not exist."""
    with suppress(OSError):
        state = os.statvfs(nearest(path))
        return state.f_bavail * state.f_frsize
    return 0


def nearest(path: Path | str) -> str:
    """The nearest existing folder at or above a path."""
    folder = os.path.abspath(path)
    while not os.path.isdir(folder):
        folder = os.path.dirname(folder)
    return folder


def _chain(error: BaseException) -> Iterator[BaseException]:
    seen: set[int] = set()
    here: BaseException | None = error
    while here is not None and id(here) not in seen:
        seen.add(id(here))
        yield here
        here = here.__cause__ or here.__context__


def _says_full(error: BaseException) -> bool:
    return (isinstance(error, OSError) and error.errno in FULL) or any(word in str(error) for word in _WORDS)


def _is_foreign(error: BaseException) -> bool:
    """Whether the error may come from a library that writes files, rather than from a bug in the rule."""
    return isinstance(error, OSError | RuntimeError) or type(error).__module__ != "builtins"


def _holds(place: Path, file: object) -> bool:
    return file is not None and os.path.abspath(str(file)).startswith(os.path.abspath(place) + os.sep)
