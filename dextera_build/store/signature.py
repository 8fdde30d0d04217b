"""File signatures from `stat`, and the record of every path that a build looked at.

An equal signature means an unchanged file, unless the file was written so shortly before the look that a second write
could get the same time stamp. `is_racy` detects that case, as git does.
"""

from __future__ import annotations

import os
import time
from typing import TypeAlias

Signature: TypeAlias = tuple[int, int, int, int]
"""(mtime_ns, ctime_ns, size, inode)."""

IGNORED = frozenset({".git", "__pycache__"})
"""Names that do not count as content of a folder."""

_MODULE_ENDINGS = frozenset({"py", "so", "zip", "pth", "dist-info", "egg-info", "egg-link"})

_FINE_NS = 20_000_000
"""Two kernel ticks at 100 Hz, the coarsest step of a file system with nanosecond stamps."""
_COARSE_NS = 2_000_000_000
"""Step of FAT; HFS+ and ext3 step by one second."""
_NEVER: Signature = (0, 0, 0, 0)
"""No file has this signature."""


def of(state: os.stat_result) -> Signature:
    """The signature in a `stat` result."""
    return (state.st_mtime_ns, state.st_ctime_ns, state.st_size, state.st_ino)


def look(path: str) -> Signature | None:
    """The signature of a file (its target, for a link), or None if it does not exist."""
    try:
        return of(os.stat(path))
    except OSError:
        return None


def names(folder: str) -> list[str] | None:
    """Names in a folder, sorted, without `IGNORED`; None if it is not a folder."""
    try:
        return sorted(name for name in os.listdir(folder) if name not in IGNORED)
    except OSError:
        return None


def modules(folder: str) -> list[str] | None:
    """Names in a folder of the module search path that an import or a version lookup can find, sorted."""
    try:
        return sorted(name for name in os.listdir(folder) if _is_module(name))
    except OSError:
        return None


def _is_module(name: str) -> bool:
    stem, dot, ending = name.rpartition(".")
    # A folder is imported by its name; temporary folders have a hyphen and are not modules.
    return name not in IGNORED and ((stem != "" and ending in _MODULE_ENDINGS) if dot else name.isidentifier())


def is_racy(signature: Signature, looked_ns: int) -> bool:
    """Whether a write after `looked_ns` (nanoseconds since the epoch) could leave the same signature."""
    mtime, ctime = signature[0], signature[1]
    margin = _FINE_NS if mtime % 1_000_000_000 else _COARSE_NS
    return max(mtime, ctime) >= looked_ns - margin


class Watch:
    """Signatures of the paths that a build reads, each taken before the read.

    Attributes:
        files: Path -> signature, None for a file that was looked for and does not exist.
        folders: Path -> sorted names, for folders whose list of names matters.
        paths: Path -> sorted names that can be imported, for folders of the module search path.
        present: Path -> signature of files that dxb wrote, which may be deleted or rewritten.
    """

    def __init__(self) -> None:
        self.files: dict[str, Signature | None] = {}
        self.folders: dict[str, list[str] | None] = {}
        self.paths: dict[str, list[str] | None] = {}
        self.present: dict[str, Signature] = {}
        self.started_ns = time.time_ns()

    def file(self, path: str | os.PathLike[str]) -> None:
        """Note a file that is about to be read; the first look counts."""
        name = os.fspath(path)
        if name not in self.files:
            self.files[name] = look(name)

    def folder(self, path: str | os.PathLike[str]) -> None:
        """Note a folder whose list of names matters."""
        name = os.fspath(path)
        if name not in self.folders:
            self.folders[name] = names(name)

    def modules(self, path: str) -> None:
        """Note a folder of the module search path."""
        if path not in self.paths:
            self.paths[path] = modules(path)

    def doubt(self, path: str, *, was_read: bool) -> None:
        """Check a path that was read before it was noted: if it may have changed in between, nothing is settled.

        An existing file needs no check: `settled` detects that it is new.

        Args:
            path: A file or folder that was noted.
            was_read: Whether it existed.
        """
        if path in self.folders and ((state := look(path)) is None or is_racy(state, self.started_ns)):
            self.folders[path] = [os.sep]  # no folder holds such a name
        if was_read and path in self.files and self.files[path] is None:
            self.files[path] = _NEVER

    def settled(self) -> bool:
        """Whether nothing changed since the first look, and no later change can go undetected."""
        files = self.files.items()
        return (
            all(look(path) == known and not (known and is_racy(known, self.started_ns)) for path, known in files)
            and all(names(path) == known for path, known in self.folders.items())
            and all(modules(path) == known for path, known in self.paths.items())
        )
