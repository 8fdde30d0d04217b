"""Files that a command read, as rows of text: whether a later command would read the same.

The rows hold the signature of every file, including missing files that were looked for, and the names in folders.
Python takes longer to start than to stat a thousand files, so this module imports almost nothing.
"""

import os

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterator

    from dextera_build.store.signature import Signature, Watch

MARK = "\0"
"""Separator of texts; no path contains it."""
_FILE, _FOLDER = 2, 4
"""Number of texts about one file, and about one folder."""


def texts(watch: "Watch", started: int) -> list[str]:
    """The rows of a watch, whose folders were looked at after `started` (nanoseconds since the epoch)."""
    files = [(path, _spelled(known)) for path, known in (*watch.files.items(), *watch.present.items())]
    folders = list(_folders(watch, started))
    return [str(len(files)), str(len(folders)), *(text for row in (*files, *folders) for text in row)]


def end(rows: list[str], start: int = 0) -> int:
    """The index after the rows that begin at `start`.

    Raises:
        ValueError: They are malformed, or an `IndexError`.
    """
    return start + 2 + _FILE * int(rows[start]) + _FOLDER * int(rows[start + 1])


def still(rows: list[str], start: int = 0) -> bool:
    """Whether all files have the recorded signatures, and all folders hold the recorded names.

    Raises:
        ValueError: The rows are malformed, or an `IndexError`.
    """
    first = start + 2
    second = first + _FILE * int(rows[start])
    return _are(rows, first, second) and _list(rows, second, end(rows, start))


def files(rows: list[str]) -> list[str]:
    """The files, existing or not, of rows that begin at 0."""
    return rows[2 : 2 + _FILE * int(rows[0]) : _FILE]


def note(rows: list[str], watch: "Watch") -> None:
    """Add the files and folders of rows that begin at 0 to a watch."""
    for path in files(rows):
        watch.file(path)
    first, last = 2 + _FILE * int(rows[0]), end(rows)
    for path, kind in zip(rows[first:last:_FOLDER], rows[first + 1 : last : _FOLDER], strict=True):
        (watch.folder if kind == "names" else watch.modules)(path)


def _are(rows: list[str], first: int, end: int) -> bool:
    stat = os.stat
    for place in range(first, end, _FILE):
        try:
            state = stat(rows[place])
        except OSError:
            if rows[place + 1]:
                return False
        else:
            if rows[place + 1] != f"{state.st_mtime_ns} {state.st_ctime_ns} {state.st_size} {state.st_ino}":
                return False
    return True


def _list(rows: list[str], first: int, end: int) -> bool:
    """Whether all folders still hold the recorded names; only folders with changed timestamps are listed."""
    for place in range(first, end, _FOLDER):
        path, kind, stamp, check = rows[place : place + _FOLDER]
        try:
            state = os.stat(path)
        except OSError:
            if check:
                return False
            continue
        if stamp != f"{state.st_mtime_ns} {state.st_ctime_ns} {state.st_ino}" and _names(path, kind) != check:
            return False
    return True


def _folders(watch: "Watch", started: int) -> "Iterator[tuple[str, str, str, str]]":
    from dextera_build.store import signature

    for kind, folders in (("names", watch.folders), ("modules", watch.paths)):
        for path, known in folders.items():
            state = signature.look(path)
            stamp = f"{state[0]} {state[1]} {state[3]}" if state and signature.is_proof(state, started) else ""
            yield path, kind, stamp, _check(known)


def _names(path: str, kind: str) -> str:
    from dextera_build.store import signature

    return _check(signature.names(path) if kind == "names" else signature.modules(path))


def _check(names: list[str] | None) -> str:
    import zlib

    return "" if names is None else str(zlib.crc32("/".join(names).encode(errors="surrogateescape")))


def _spelled(known: "Signature | None") -> str:
    return " ".join(map(str, known)) if known else ""
