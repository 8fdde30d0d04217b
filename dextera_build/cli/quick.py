"""The quickest build that does nothing: the command line of before, and all that its answer rests on is as it was.

Python takes longer to start than to look at a thousand files, so this loads next to nothing. It reads what `notes`
wrote; where anything is not as it was noted, the command goes on as if this did not exist.
"""

import os
import sys
import time

FORM = 2
"""Of a note."""
SECTIONS = ("request", "told", "answers", "snapshots", "contents", "files", "absent", "folders", "shards")
"""Parts of a note, each of rows of texts; `spell` puts them into one text, which splits fast."""
_CHECK = 4
"""Bytes of the check sum in front."""
_MARKS = "\x1d\x1e\x1f"
_PLACES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
"""Variables beside `DXB_*` that say where things are."""


def answer(words: list[str]) -> bool:
    """Give the answer of last time to a command line (without `dxb`) where it still holds; else do nothing."""
    began = time.perf_counter()
    note = read(words) if words[:1] == ["build"] else None
    if note is None or not holds(note):
        return False
    for recipe, nodes, lines in note["answers"]:
        if note["told"] == [["yes"]]:
            many = "s" * (nodes != "1")
            sys.stderr.write(f"{recipe} is up to date   {nodes} node{many}   {time.perf_counter() - began:.2f} s\n")
        sys.stdout.write(lines)
    return True


def request(words: list[str], version: str) -> str:
    """The digest of all that is asked, but for files: variables and words may hold passwords, and a note is a file."""
    import hashlib

    said = [(name, value) for name, value in os.environ.items() if name.startswith("DXB_") or name in _PLACES]
    asked = repr((FORM, version, sys.version, sys.path, words, os.getcwd(), sorted(said)))
    return hashlib.sha256(asked.encode()).hexdigest()


def place(asked: str) -> str:
    """Where the note of a request lies: on this machine, and this user's own."""
    import zlib

    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return f"{home}/dxb/local/quick/{zlib.crc32(asked.encode()):08x}"


def spell(note: dict[str, list[list[str]]]) -> bytes:
    """A note as bytes.

    Raises:
        ValueError: A text holds a character that separates texts.
    """
    sections = [note[name] for name in SECTIONS]
    text = _MARKS[0].join(_MARKS[1].join(map(_MARKS[2].join, rows)) for rows in sections)
    between = (
        len(sections) - 1,
        sum(len(rows) - 1 for rows in sections if rows),
        sum(len(row) - 1 for rows in sections for row in rows),
    )
    if tuple(map(text.count, _MARKS)) != between:
        raise ValueError("a text cannot be told from two")
    return text.encode(errors="surrogateescape")


def sealed(data: bytes) -> bytes:
    """What is to be written, so that `opened` finds damage."""
    import zlib

    return zlib.crc32(data).to_bytes(_CHECK, "big") + data


def opened(path: str) -> bytes:
    """What `sealed` made, from a file.

    Raises:
        OSError: It cannot be read.
        ValueError: It was damaged.
    """
    import zlib

    data = _bytes(path)
    if zlib.crc32(memoryview(data)[_CHECK:]).to_bytes(_CHECK, "big") != data[:_CHECK]:
        raise ValueError("the file was damaged")
    return data[_CHECK:]


def stamp(state: os.stat_result) -> str:
    """What of a file's `stat` counts."""
    return f"{state.st_mtime_ns} {state.st_ctime_ns} {state.st_size} {state.st_ino}"


def read(words: list[str]) -> dict[str, list[list[str]]] | None:
    """The note of a command line in this folder, or None where there is none; `holds` tells whether it holds."""
    from dextera_build.version import __version__

    try:
        asked = request(words, __version__)
        parts = opened(place(asked)).decode(errors="surrogateescape").split(_MARKS[0])
        rows = ([row.split(_MARKS[2]) for row in part.split(_MARKS[1])] if part else [] for part in parts)
        note = dict(zip(SECTIONS, rows, strict=True))
    except (OSError, ValueError):
        return None
    return note if note["request"] == [[asked]] else None


def holds(note: dict[str, list[list[str]]]) -> bool:
    """Whether all that a note rests on is as it was."""
    stat = os.stat
    try:
        for path, known in note["files"]:
            if stamp(stat(path)) != known:
                return False
        if any(os.path.exists(path) for (path,) in note["absent"]) or not _stand(note["folders"]):
            return False
        # Of use before the look at the store, or a collection could find it unused after the store was found whole.
        for (path,) in note["snapshots"]:
            os.utime(path)
        return all(_bytes(path).decode() == known for path, known in note["contents"]) and _stand(note["shards"])
    except OSError:
        return False


def _stand(folders: list[list[str]]) -> bool:
    """Whether no name came into these folders or went out of them."""
    stat = os.stat
    for path, known in folders:
        state = stat(path)
        if f"{state.st_mtime_ns} {state.st_ino}" != known:
            return False
    return True


def _bytes(path: str) -> bytes:
    with open(path, "rb", buffering=0) as file:
        return file.read()
