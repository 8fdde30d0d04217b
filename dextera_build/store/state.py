"""What a store remembers on this machine: one SQLite file of small rows, each with a check sum.

All of it can be found out again. So a damaged file is set aside, and where the disk is full, the file may not be
written, or another build holds it for too long, nothing is remembered. No other module speaks SQL.
"""

import os
import zlib

TYPE_CHECKING = False  # a build of which nothing changed loads next to nothing
if TYPE_CHECKING:
    import sqlite3
    from collections.abc import Callable, Iterable, Mapping
    from typing import TypeVar

    T = TypeVar("T")

_FORM = 1
_PATIENCE_S = 20.0
"""How long a build waits for another that writes."""
_TABLE = "CREATE TABLE rows (kind BLOB, name BLOB, value BLOB, sum INT, PRIMARY KEY (kind, name)) WITHOUT ROWID"
_SELECT = "SELECT name, value, sum FROM rows WHERE kind=?"
_AT_ONCE = 500
"""Rows that one statement asks for."""
_CORRUPT, _NOT_A_DATABASE, _GENERIC, _READ_ONLY, _CANNOT_OPEN = 11, 26, 1, 8, 14
"""Error codes of SQLite."""
_NETWORK = ("nfs", "cifs", "smb", "9p", "afs", "ceph", "gluster", "lustre", "gpfs", "beegfs", "fuse.", "virtiofs")
"""How names of file systems begin that several machines may share: a write-ahead log is not safe there."""


class State:
    """Rows by kind and name.

    Args:
        path: The file; the first `put` makes it.
        takes: False where nothing may be written.
    """

    def __init__(self, path: str, *, takes: bool = True) -> None:
        self._path = path
        self._takes = takes

    def get(self, kind: str, name: str) -> bytes | None:
        """The value of one row, None where there is none."""
        return self.some(kind, [name]).get(name)

    def some(self, kind: str, names: "Iterable[str]") -> dict[str, bytes]:
        """The values of those of `names` that have one."""
        wanted = [_bytes(name) for name in names]

        def read(base: "sqlite3.Connection") -> list[tuple[bytes, bytes, int]]:
            found: list[tuple[bytes, bytes, int]] = []
            for first in range(0, len(wanted), _AT_ONCE):
                part = wanted[first : first + _AT_ONCE]
                found += base.execute(f"{_SELECT} AND name IN ({','.join('?' * len(part))})", (_bytes(kind), *part))
            return found

        return _whole(kind, self._read(read))

    def all(self, kind: str) -> dict[str, bytes]:
        """Every row of a kind."""
        return _whole(kind, self._read(lambda base: list(base.execute(_SELECT, (_bytes(kind),)))))

    def kinds(self) -> list[str]:
        """Every kind of which there are rows."""
        found = self._read(lambda base: list(base.execute("SELECT DISTINCT kind FROM rows")))
        return [_text(kind) for (kind,) in found if type(kind) is bytes]

    def put(self, kind: str, rows: "Mapping[str, bytes]", *, without: "Iterable[str]" = ()) -> bool:
        """Write rows, all or none; False where that cannot be.

        Args:
            kind: Of the rows.
            rows: Name -> value.
            without: Names of rows to delete.
        """
        gone = [(_bytes(kind), _bytes(name)) for name in without]
        made = [(_bytes(kind), _bytes(name), value, _sum(kind, name, value)) for name, value in rows.items()]

        def write(base: "sqlite3.Connection") -> bool:
            with base:  # commits, or takes all of it back
                base.execute("BEGIN IMMEDIATE")
                base.executemany("DELETE FROM rows WHERE kind=? AND name=?", gone)
                base.executemany("INSERT OR REPLACE INTO rows VALUES (?, ?, ?, ?)", made)
            return True

        return self._takes and bool(self._try(write, writes=True))

    def _read(self, work: "Callable[[sqlite3.Connection], list[T]]") -> "list[T]":
        return self._try(work, writes=False) or [] if os.path.exists(self._path) else []

    def _try(self, work: "Callable[[sqlite3.Connection], T]", *, writes: bool) -> "T | None":
        import sqlite3

        how = "" if self._takes else "?immutable=1"
        for _ in range(3):
            try:
                base = self._open(how, writes=writes)
                try:
                    return work(base)
                finally:
                    base.close()
            except sqlite3.Error as error:
                code = getattr(error, "sqlite_errorcode", _CORRUPT) & 0xFF
                if code in (_READ_ONLY, _CANNOT_OPEN) and not (writes or how or os.path.isdir(self._path)):
                    how = "?immutable=1"  # the file is another user's
                elif not self._takes or not self._is_damage(code, writes) or not self._set_aside() or not writes:
                    return None
            except OSError:
                return None
        return None

    def _is_damage(self, code: int, writes: bool) -> bool:
        # A reader may come between the making of the file and that of its table, which is a generic error.
        return code in (_CORRUPT, _NOT_A_DATABASE) or (writes and code == _GENERIC) or os.path.isdir(self._path)

    def _open(self, how: str, *, writes: bool) -> "sqlite3.Connection":
        import sqlite3

        if writes and not os.path.exists(self._path):
            self._make()
        path = os.fsencode(self._path)
        for sign in b"%?#":
            path = path.replace(bytes([sign]), b"%%%02x" % sign)
        place = b"file:" + path + how.encode()
        base = sqlite3.connect(place, _PATIENCE_S, isolation_level=None, uri=True)
        try:
            if writes:
                base.execute("PRAGMA synchronous=NORMAL")
                if base.execute("PRAGMA user_version").fetchone()[0] != _FORM:
                    self._fill(base)
        except BaseException:
            base.close()
            raise
        return base

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

    def _fill(self, base: "sqlite3.Connection") -> None:
        """Make the table in an empty file, or in one of another form."""
        from contextlib import suppress
        from sqlite3 import OperationalError

        if not is_shared(self._path):
            with suppress(OperationalError):  # another build is here too: the rollback journal does as well
                base.execute("PRAGMA journal_mode=WAL")
        with base:
            base.execute("BEGIN IMMEDIATE")
            if base.execute("PRAGMA user_version").fetchone()[0] != _FORM:
                base.execute("DROP TABLE IF EXISTS rows")
                base.execute(_TABLE)
                base.execute(f"PRAGMA user_version={_FORM}")

    def _set_aside(self) -> bool:
        """Take a damaged file out of the way; False where that cannot be."""
        try:
            os.replace(self._path, f"{self._path}~")
            for ending in ("-wal", "-shm", "-journal"):
                if os.path.exists(self._path + ending):
                    os.unlink(self._path + ending)
        except OSError:
            return False
        return True


def is_shared(path: str, mounts: str = "/proc/self/mounts") -> bool:
    """Whether a file lies on a file system that several machines may use at once; True also where that is not known."""
    here, best, kind = os.path.realpath(path), "", "nfs"
    try:
        with open(mounts, encoding="utf-8", errors="surrogateescape") as file:
            for line in file:
                _, where, found, *_ = line.split(" ")
                where = where.replace("\\040", " ")
                if len(where) >= len(best) and (here == where or here.startswith(where.rstrip("/") + "/")):
                    best, kind = where, found
    except (OSError, ValueError):
        return True
    return kind.startswith(_NETWORK)


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _text(data: bytes) -> str:
    return data.decode("utf-8", "surrogatepass")


def _sum(kind: str, name: str, value: bytes) -> int:
    return zlib.crc32(value, zlib.crc32(_bytes(f"{kind}\0{name}")))


def _whole(kind: str, rows: "Iterable[tuple[bytes, bytes, int]]") -> dict[str, bytes]:
    """The rows that are as they were written."""
    head = zlib.crc32(_bytes(f"{kind}\0"))
    return {
        _text(name): value
        for name, value, known in rows
        if type(name) is type(value) is bytes and zlib.crc32(value, zlib.crc32(name, head)) == known
    }
