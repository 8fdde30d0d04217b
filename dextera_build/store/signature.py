"""File signatures from `stat`, and the record of every path that a build looked at.

An equal signature means an unchanged file, with two exceptions. If the file was written shortly before the look, a
second write could get the same time stamp; `is_racy` detects that case, as git does. And where the kernel does not set
ctime, as in a read-only image, the next version of a file may have all stamps of this one; `of` then gives no ctime.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from functools import cache
from typing import TypeAlias

Signature: TypeAlias = tuple[int, int, int, int]
"""(mtime_ns, ctime_ns, size, inode); ctime is `_NO_CTIME` where it proves nothing."""

IGNORED = frozenset({".git", "__pycache__"})
"""Names that do not count as content of a folder."""

_MODULE_ENDINGS = frozenset({"py", "so", "zip", "pth", "dist-info", "egg-info", "egg-link"})

_FINE_NS = 20_000_000
"""Two kernel ticks at 100 Hz, the coarsest step of a file system with nanosecond stamps."""
_COARSE_NS = 2_000_000_000
"""Step of FAT; HFS+ and ext3 step by one second."""
_NO_CTIME = 0
_SECOND_NS = 1_000_000_000
_MOUNTS = "/proc/self/mountinfo"
_NEVER: Signature = (0, 0, 0, 0)
"""No file has this signature."""


def of(state: os.stat_result) -> Signature:
    """The signature in a `stat` result."""
    ctime = state.st_ctime_ns if _sets_ctime(state) else _NO_CTIME
    return (state.st_mtime_ns, ctime, state.st_size, state.st_ino)


def _sets_ctime(state: os.stat_result) -> bool:
    """Whether the ctime in a `stat` result was set by a kernel when the file changed."""
    known = _devices().get(state.st_dev)
    return state.st_ctime_ns % _SECOND_NS != 0 if known is None else known


@cache
def _devices() -> dict[int, bool]:
    """Device number -> whether its file system sets ctime itself; others may if ctime has fractions of a second.

    A read-only medium (squashfs, erofs, an image of ext4) is replaced as a whole, and images made reproducibly agree in
    all stamps and inodes. Layers may lie on such a medium; FAT and some file systems in user space repeat mtime.
    """
    found = {}
    try:
        for device, kind, source, options in mounts():
            if kind in ("overlay", "vfat") or kind.startswith("fuse"):
                continue
            is_medium = source.startswith("/dev/") and "ro" in options.split(",")
            found[device] = not is_medium
    except (OSError, ValueError, IndexError):
        return {}
    return found


def mounts() -> Iterator[tuple[int, str, str, str]]:
    """(device number, type, source, options) of every mounted file system.

    Raises:
        OSError: The system does not list them.
        ValueError: A line is malformed, or an `IndexError`.
    """
    with open(_MOUNTS, encoding="utf-8", errors="surrogateescape") as file:
        for line in file:
            before, _, after = line.partition(" - ")
            major, _, minor = before.split(" ")[2].partition(":")
            kind, source, options = after.split()[:3]
            yield os.makedev(int(major), int(minor)), kind, source, options


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


def is_proof(signature: Signature, looked_ns: int) -> bool:
    """Whether a file that has this signature later is the file that was looked at (nanoseconds since the epoch)."""
    return signature[1] != _NO_CTIME and not is_racy(signature, looked_ns)


def is_racy(signature: Signature, looked_ns: int) -> bool:
    """Whether a write after `looked_ns` (nanoseconds since the epoch) could leave the same signature."""
    mtime, ctime = signature[0], signature[1]
    margin = _FINE_NS if mtime % _SECOND_NS else _COARSE_NS
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
        for folders in (self.folders, self.paths):
            if path in folders and ((state := look(path)) is None or not is_proof(state, self.started_ns)):
                folders[path] = [os.sep]  # no folder holds such a name
        if was_read and path in self.files and self.files[path] is None:
            self.files[path] = _NEVER

    def settled(self) -> bool:
        """Whether nothing changed since the first look, and no later change can go undetected."""
        files = self.files.items()
        return (
            all(look(path) == known and (not known or is_proof(known, self.started_ns)) for path, known in files)
            and all(names(path) == known for path, known in self.folders.items())
            and all(modules(path) == known for path, known in self.paths.items())
        )
