"""A store's local state on this machine: one SQLite file of small rows, each with a checksum.

All of it can be recomputed. A damaged file is therefore moved aside, and nothing is saved if the disk is full, the file
cannot be written, or another build locks it for too long. No other module uses SQL.

On a file system without locks, builds at once may damage the file, which costs only its content.
"""

import os
import zlib

TYPE_CHECKING = False  # a no-op build imports next to nothing
if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Callable, Iterable, Mapping
    from typing import TypeVar

    T = TypeVar("T")

_PATIENCE_S = 20.0
"""How long a build waits for another build's write [s]."""
_TABLE = """CREATE TABLE IF NOT EXISTS rows
(kind BLOB, name BLOB, value BLOB, sum INT, PRIMARY KEY (kind, name)) WITHOUT ROWID"""
_SELECT = "SELECT name, value, sum FROM rows WHERE kind=?"
_CORRUPT, _NOT_A_DATABASE, _GENERIC, _BUSY, _IO = 11, 26, 1, 5, 10
"""Error codes of SQLite."""
_lockless: set[str] = set()
"""Files on file systems without locks."""


class State:
    """Rows by kind and name.

    Args:
        path: The file; created by the first `put`.
        takes: False for a read-only store.
    """

    def __init__(self, path: str, *, takes: bool = True) -> None:
        self._path = path
        self._takes = takes

    def get(self, kind: str, name: str) -> bytes | None:
        """The value of one row, or None."""
        return self.some(kind, [name]).get(name)

    def some(self, kind: str, names: "Iterable[str]") -> dict[str, bytes]:
        """Name -> value for the rows in `names` that exist; meant for a few names."""
        wanted = [_bytes(name) for name in names]
        select = f"{_SELECT} AND name IN ({','.join('?' * len(wanted))})"
        return _whole(kind, self._read(lambda base: list(base.execute(select, (_bytes(kind), *wanted)))))

    def all(self, kind: str) -> dict[str, bytes]:
        """Every row of a kind."""
        return _whole(kind, self._read(lambda base: list(base.execute(_SELECT, (_bytes(kind),)))))

    def kinds(self) -> list[str]:
        """Every kind that has rows."""
        found = self._read(lambda base: list(base.execute("SELECT DISTINCT kind FROM rows")))
        return [_text(kind) for (kind,) in found if type(kind) is bytes]

    def put(self, kind: str, rows: "Mapping[str, bytes]", *, without: "Iterable[str]" = ()) -> bool:
        """Write rows, all or none; return False if that fails.

        Args:
            kind: Kind of the rows.
            rows: Name -> value.
            without: Names of rows to delete.
        """
        gone = [(_bytes(kind), _bytes(name)) for name in without]
        made = [(_bytes(kind), _bytes(name), value, _sum(kind, name, value)) for name, value in rows.items()]

        def write(base: "sqlite3.Connection") -> bool:
            with base:  # commits or rolls back
                base.execute("BEGIN IMMEDIATE")
                base.execute(_TABLE)
                base.executemany("DELETE FROM rows WHERE kind=? AND name=?", gone)
                base.executemany("INSERT OR REPLACE INTO rows VALUES (?, ?, ?, ?)", made)
            return True

        return self._takes and bool(self._try(write, writes=True))

    def put_newest(self, kind: str, name: str, value: bytes, *, most: int) -> bool:
        """Write a row, and delete the oldest rows of its kind that were written this way, beyond the number `most`."""
        import time

        times = f"{kind} made"
        done, made = self.put(kind, {name: value}), self.all(times)
        old = sorted(made.keys() - {name}, key=lambda one: made[one])[: max(0, len({*made, name}) - most)]
        self.put(times, {name: b"%020d" % time.time_ns()}, without=old)
        self.put(kind, {}, without=old)
        return done

    def _read(self, work: "Callable[[sqlite3.Connection], list[T]]") -> "list[T]":
        return self._try(work, writes=False) or [] if os.path.exists(self._path) else []

    def _try(self, work: "Callable[[sqlite3.Connection], T]", *, writes: bool) -> "T | None":
        import sqlite3

        patience_s = 0.0
        for _ in range(3):
            try:
                if writes and not os.path.exists(self._path):
                    self._make()
                base = self._connected(patience_s)
                try:
                    # A power cut may damage the file, which is detected; a build flushes everything at its end.
                    base.execute("PRAGMA synchronous=OFF")
                    return work(base)
                finally:
                    base.close()
            except (sqlite3.Error, UnicodeDecodeError) as error:  # messages quote the file's bytes
                code = getattr(error, "sqlite_errorcode", _CORRUPT) & 0xFF
                if code in (_BUSY, _IO) and not patience_s:
                    self._look_for_locks()
                    patience_s = _PATIENCE_S
                elif not self._takes or not self._is_damage(code, writes) or not self._set_aside() or not writes:
                    return None
            except OSError:
                return None
        return None

    def _connected(self, patience_s: float) -> "sqlite3.Connection":
        import sqlite3

        if self._path not in _lockless:
            return sqlite3.connect(self._path, timeout=patience_s, isolation_level=None)
        from urllib.parse import quote

        name = quote(os.fsencode(os.path.abspath(self._path)))
        return sqlite3.connect(f"file:{name}?vfs=unix-none", timeout=patience_s, isolation_level=None, uri=True)

    def _look_for_locks(self) -> None:
        """Note whether the file system has no locks: SQLite takes that for a lock of another build, and would wait."""
        from pathlib import Path

        from dextera_build.store.locks import Locks

        if Locks(Path(self._path).with_name("locks")).are_missing():
            _lockless.add(self._path)

    def _is_damage(self, code: int, writes: bool) -> bool:
        # A reader may see the file before its table exists, which is a generic error.
        return code in (_CORRUPT, _NOT_A_DATABASE) or (writes and code == _GENERIC) or os.path.isdir(self._path)

    def _make(self) -> None:
        """Make an empty file with the permissions of the store; SQLite gives its other files the same."""
        from dextera_build.store import permissions

        folder = os.path.dirname(self._path)
        permissions.make_folder(folder)
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            permissions.share_file(descriptor, folder, 0o644)
        finally:
            os.close(descriptor)

    def _set_aside(self) -> bool:
        """Move a damaged file aside; return False if that fails."""
        try:
            os.replace(self._path, f"{self._path}~")
            if os.path.exists(f"{self._path}-journal"):
                os.unlink(f"{self._path}-journal")
        except OSError:
            return False
        return True


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _text(data: bytes) -> str:
    return data.decode("utf-8", "surrogatepass")


def _sum(kind: str, name: str, value: bytes) -> int:
    return zlib.crc32(value, zlib.crc32(_bytes(f"{kind}\0{name}")))


def _whole(kind: str, rows: "Iterable[tuple[bytes, bytes, int]]") -> dict[str, bytes]:
    """The rows whose checksums are correct."""
    head = zlib.crc32(_bytes(f"{kind}\0"))
    return {
        _text(name): value
        for name, value, known in rows
        if type(name) is type(value) is bytes and zlib.crc32(value, zlib.crc32(name, head)) == known
    }
