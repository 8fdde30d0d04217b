"""The build that does nothing: when no file that mattered has changed, the last answer still holds.

A snapshot is a request, a stat signature of every file that was read for it, and the lines that it printed. It is only
written when each of those files was at rest, so equal signatures mean equal bytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import files, signature
from dextera_build.store.signature import Watch

_FORM = 1


@dataclass(frozen=True)
class Snapshot:
    """What was asked for, and what the answer was."""

    request: Mapping[str, object]
    """Everything but files that the answer depends on: targets, profile, flags, version of dxb."""
    lines: tuple[str, ...]
    """The lines of the result."""


def load_if_fresh(path: Path, request: Mapping[str, object]) -> Snapshot | None:
    """The snapshot at `path`, if it answers `request` and no file that it rests on has changed."""
    try:
        stored = json.loads(files.read(str(path)))
        if stored["form"] != _FORM or stored["request"] != json.loads(json.dumps(request)):
            return None
        if not _is_fresh(stored):
            return None
        return Snapshot(stored["request"], tuple(stored["lines"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def save(path: Path, request: Mapping[str, object], watch: Watch, lines: Sequence[str]) -> bool:
    """Write a snapshot, all or nothing.

    Args:
        path: Where to.
        request: Plain data; see `Snapshot.request`.
        watch: What was read, noted before it was read.
        lines: The answer.

    Returns:
        False where it was not written: a file was not at rest, or the store cannot be written. Then there is none.
    """
    with suppress(OSError):
        path.unlink()
    if not watch.settled():
        return False
    stored = {
        "form": _FORM,
        "request": request,
        "lines": list(lines),
        "files": watch.files,
        "folders": watch.folders,
        "present": watch.present,
    }
    try:
        files.write(str(path), json.dumps(stored).encode(), 0o644)
    except StoreError:
        return False
    return True


def _is_fresh(stored: Mapping[str, Mapping[str, object]]) -> bool:
    for path, known in stored["files"].items():
        seen = signature.look(path)
        if (list(seen) if seen is not None else None) != known:
            return False
    for path, known in stored["folders"].items():
        if signature.names(path) != known:
            return False
    return all(os.stat(path).st_size == size for path, size in stored["present"].items())
