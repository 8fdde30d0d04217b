"""Which files of a store a build relies on, and whether they are still there, without a look at each.

A folder's time stamp moves when a name in it comes or goes, so as long as the folder `cas/ab` is as it was, nothing in
it was deleted. Only where it moved, or where the machine was started anew since (a power cut leaves short files), each
file is looked at.
"""

from __future__ import annotations

import os
import time
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, BinaryIO, TypeAlias

from dextera_build.store import files, signature

if TYPE_CHECKING:
    from dextera_build.store.entry import File

_ROW = 40
"""32 bytes of digest, 8 of size."""
_MOST_HELD = 20_000
"""Rows in memory: 1 MB."""
_ANY = b"\xff" * 8
"""Stands for any size."""
Shards: TypeAlias = dict[str, list[int]]
"""Folder below the root, `cas/ab` -> [time stamp (0: too young to trust), inode, first row, end of rows, ...]."""
BOOT = "/proc/sys/kernel/random/boot_id"
"""Has other bytes after each start of the machine."""


class Presence:
    """Collects files of one store.

    Args:
        root: The store's folder.
    """

    def __init__(self, root: str) -> None:
        self._root = root
        self._rows: dict[str, bytearray] = defaultdict(bytearray)
        self._held = 0
        """How many rows are in memory."""
        self._aside: BinaryIO | None = None
        self._pieces: dict[str, array[int]] = defaultdict(lambda: array("Q"))
        """Where the rows of a folder lie that were laid aside: place, length, and so on."""

    def note(self, key: str, needs: Iterable[File]) -> None:
        """Rely on the result of a key and on all that it needs."""
        self._rows[f"ac/{key[:2]}"] += bytes.fromhex(key) + _ANY
        self._held += 1
        for file in needs:
            digest = file.digest
            self._rows[f"cas/{digest[:2]}"] += bytes.fromhex(f"{digest}{file.size:016x}")
            self._held += 1
        if self._held > _MOST_HELD:
            self._lay_aside()

    def _lay_aside(self) -> None:
        """Let rows lie in a file without a name: those of a hundred thousand nodes take 24 MB."""
        from tempfile import TemporaryFile

        self._held = 0
        with suppress(OSError):  # where there is no room for it they stay in memory
            if self._aside is None:
                self._aside = TemporaryFile(buffering=0)  # noqa: SIM115 - as long as the build
            place = self._aside.seek(0, os.SEEK_END)
            files.write_all(self._aside.fileno(), b"".join(self._rows.values()))
            for shard, rows in self._rows.items():
                self._pieces[shard].extend((place, len(rows)))
                place += len(rows)
            self._rows.clear()

    def _shards(self) -> list[str]:
        return sorted({*self._rows, *self._pieces})

    def _noted(self, shard: str) -> list[bytes]:
        """The rows of a folder, each once; they are not held any more."""
        rows = bytes(self._rows.pop(shard, b""))
        pieces = self._pieces.pop(shard, array("Q"))
        for place, size in zip(pieces[::2], pieces[1::2], strict=True):
            assert self._aside is not None
            rows += os.pread(self._aside.fileno(), size, place)
        return sorted({rows[place : place + _ROW] for place in range(0, len(rows), _ROW)})

    def freeze(self, take: Callable[[bytes], None]) -> Shards | None:
        """The folders as they are now, or None where a file of theirs is gone already; then it is empty.

        Args:
            take: Gets the rows of one folder after the other: together they take as much memory as a plan.
        """
        shards: Shards = {}
        place = 0
        for shard in self._shards():
            rows = b"".join(self._noted(shard))
            found = look(self._root, shard)
            if found is None or not _named(self._root, shard, rows):
                return None
            take(rows)
            end = place + len(rows) // _ROW
            shards[shard] = [*found, place, end]
            place = end
        return shards


def look(root: str, shard: str) -> tuple[int, int] | None:
    """(time stamp, or 0 where it is too young to be trusted; inode) of a folder of the store, None where it is gone."""
    now = time.time_ns()
    try:
        state = os.stat(f"{root}/{shard}")
    except OSError:
        return None
    seen = signature.of(state)
    return (0 if signature.is_racy(seen, now) else seen[0], seen[3])


def moved(root: str, shards: Shards) -> list[str]:
    """The folders that are not what they were, or that were too young to be trusted."""
    found = []
    for shard, row in shards.items():
        if row[0]:
            with suppress(OSError):
                state = os.stat(f"{root}/{shard}")
                if state.st_mtime_ns == row[0] and state.st_ino == row[1]:
                    continue
        found.append(shard)
    return found


def whole(root: str, rows: bytes | bytearray | memoryview, shard: str, row: list[int]) -> bool:
    """Whether every file that is relied on in a folder is there with its size."""
    stat, folder = os.stat, f"{root}/{shard}/"
    try:
        for first, end in zip(row[2::2], row[3::2], strict=True):
            for place in range(first * _ROW, end * _ROW, _ROW):
                name = folder + rows[place + 1 : place + 32].hex()
                size, known = stat(name).st_size, rows[place + 32 : place + 40]
                if known not in (_ANY, size.to_bytes(8, "big")):
                    return False
    except OSError:
        return False
    return True


def _named(root: str, shard: str, rows: bytes) -> bool:
    """Whether every file that is relied on in a folder has its name in it."""
    text = rows.hex()
    return frozenset(_names(f"{root}/{shard}")).issuperset(
        [text[place : place + 62] for place in range(2, len(text), 2 * _ROW)]
    )


def digests(rows: memoryview, shards: Shards) -> Iterator[str]:
    """What is relied on in some folders."""
    for row in shards.values():
        for first, end in zip(row[2::2], row[3::2], strict=True):
            yield from (rows[place * _ROW : place * _ROW + 32].hex() for place in range(first, end))


def boot() -> str:
    """Names the time since the machine was started; "" where the system does not say."""
    try:
        with open(BOOT) as file:
            return file.read().strip()
    except OSError:
        return ""


def _names(folder: str) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []
