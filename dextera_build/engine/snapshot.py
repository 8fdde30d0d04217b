"""The build that does nothing: when no file that mattered has changed, the last answer still holds.

A snapshot is a request, a stat signature of every file that was read for it, the store's folders that hold its results,
and the lines that it printed. It is only written when each of those files was at rest, so equal signatures mean equal
bytes.

    <name>         digest of the head, a line break, the head (JSON)
    <name>.rows    what `presence` needs where a folder of the store moved
"""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

from dextera_build import digest as digests
from dextera_build.errors import StoreError
from dextera_build.store import failpoints, files, presence, signature
from dextera_build.store.presence import Presence
from dextera_build.store.signature import Watch

_FORM = 3
Head: TypeAlias = dict[str, Any]
"""What a snapshot says, but for the rows."""


class _UnsettledError(Exception):
    """What the build read or made is another thing by now."""


class _Rows:
    """Writes rows, and says how much and what that was."""

    def __init__(self, target: int) -> None:
        self._target = target
        self.size = self.check = 0

    def take(self, rows: bytes) -> None:
        """Write some more."""
        files.write_all(self._target, rows)
        self.size, self.check = self.size + len(rows), zlib.crc32(rows, self.check)


def load_if_fresh(path: Path, request: Mapping[str, object]) -> Head | None:
    """The snapshot at `path`, if it answers `request` and nothing that it rests on has changed."""
    try:
        head = read_head(path)
        if head["request"] != json.loads(json.dumps(request)):
            return None
        _use(path)
        return head if is_present(path, head) and _is_as_it_was(head) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):
        return None


def _is_as_it_was(head: Head) -> bool:
    """Whether all files and folders are what they were."""
    return (
        all(list(signature.look(name) or ()) == (known or []) for name, known in head["files"].items())
        and all(signature.names(name) == known for name, known in head["folders"].items())
        and all(signature.modules(name) == known for name, known in head["paths"].items())
        and all(list(signature.look(path) or ()) == known for path, known in head["present"].items())
    )


def save(
    path: Path,
    request: Mapping[str, object],
    watch: Watch,
    lines: Sequence[str],
    store: tuple[str, Presence] | None = None,
) -> Head | None:
    """Write a snapshot, all or nothing.

    Args:
        path: Where to.
        request: Plain data: everything but files that the answer depends on (targets, profile, flags, version of dxb).
        watch: What was read, noted before it was read.
        lines: The answer.
        store: The store's folder, and what of it the answer relies on.

    Returns:
        Its head, or None where it was not written: a file was not at rest, or the store cannot be written. Then there
        is none.
    """
    forget(path)
    try:
        with files.new_file(f"{path}.rows", 0o644) as target:
            rows = _Rows(target)
            shards = store[1].freeze(rows.take) if store else {}
            if shards is None or not watch.settled():
                raise _UnsettledError
    except (StoreError, _UnsettledError):
        return None
    failpoints.reach("snapshot.rows")
    head = {
        "form": _FORM,
        "request": request,
        "lines": list(lines),
        "files": watch.files,
        "folders": watch.folders,
        "paths": watch.paths,
        "present": watch.present,
        "store": store[0] if store else "",
        "boot": presence.boot(),
        "shards": shards,
        "rows": [rows.size, rows.check],
    }
    try:
        _write(path, head)
    except StoreError:
        return None
    failpoints.reach("snapshot.saved")
    return head


def forget(path: Path) -> None:
    """There is no snapshot any more."""
    with suppress(OSError):
        path.unlink()
    failpoints.reach("snapshot.forgotten")


def _rows(path: Path, head: Mapping[str, Any]) -> memoryview:
    size, check = head["rows"]
    rows = memoryview(files.read(f"{path}.rows"))[:size]
    if len(rows) != size or zlib.crc32(rows) != check:
        raise ValueError("the rows were damaged")
    return rows


def read_head(path: Path) -> Head:
    """The head of a snapshot.

    Raises:
        OSError: There is none.
        ValueError: It was damaged, or another version wrote it.
    """
    data = files.read(str(path))
    text = data[65:]
    if hashlib.sha256(text).hexdigest().encode() != data[:64]:
        raise ValueError("the head was damaged")
    head: Head = digests.plain(text)
    if head["form"] != _FORM:
        raise ValueError("another form")
    return head


def held(path: Path) -> tuple[str, set[str]]:
    """(the project's folder, the keys whose results it relies on) of the snapshot at `path`.

    Raises:
        OSError: There is none.
        ValueError: It was damaged, or another version wrote it.
    """
    head = read_head(path)
    rows = _rows(path, head)
    areas = {shard: row for shard, row in head["shards"].items() if shard.startswith("ac/")}
    return str(head["request"].get("root", "")), set(presence.digests(rows, areas))


def is_present(path: Path, head: Head) -> bool:
    """Whether all that a snapshot relies on in the store is there; notes what had to be looked at one by one.

    Raises:
        OSError: The rows cannot be read.
        ValueError: They were damaged.
    """
    now = presence.boot()
    shards: presence.Shards = head["shards"]
    late = presence.moved(head["store"], shards) if head["boot"] == now else list(shards)
    if not late:
        return True
    rows = _rows(path, head)
    renewed = dict(shards)
    for shard in late:
        found = presence.look(head["store"], shard)
        if found is None or not presence.whole(head["store"], rows, shard, shards[shard]):
            return False
        renewed[shard] = [*found, *shards[shard][2:]]
    if renewed != shards or head["boot"] != now:
        head.update(shards=renewed, boot=now)
        with suppress(StoreError):
            _write(path, head)
    return True


def _use(path: Path) -> None:
    """Say that what the snapshot relies on is of use still: a collection lets go of those that nobody used for long.

    That comes before the look at the store, or a collection could find it unused after we found the store whole.
    """
    with suppress(OSError):
        failpoints.reach("snapshot.used")
        os.utime(path)


def _write(path: Path, head: Mapping[str, object]) -> None:
    text = json.dumps(head).encode()
    files.write(str(path), hashlib.sha256(text).hexdigest().encode() + b"\n" + text, 0o644)
