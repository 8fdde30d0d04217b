"""Digests files and folders of a project as artifacts, without reading unchanged files again.

As git does: a file whose (mtime, ctime, size, inode) is known keeps its digest, unless it was written so shortly before
it was read that a second write could have left the same stamps, or the kernel does not set its stamps (see
`signature`); then it is read again.
"""

from __future__ import annotations

import errno
import json
import os
import stat
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import RecipeError, StoreError
from dextera_build.store import disk_full, failpoints, headers, signature
from dextera_build.store.blobs import Blobs, is_digest
from dextera_build.store.state import State

_KIND = "leaf"
_TRIES = 3
_FEW = 32
"""Fewer files than this are read one after another: threads would cost more than they save."""


class StatCache:
    """Digests of project files; the table is local to this machine.

    Args:
        blobs: Stores the contents.
        state: Keeps signatures between runs; written by `save`.

    Attributes:
        watch: If set, it notes every file and folder that is looked at.
    """

    def __init__(self, blobs: Blobs, state: State) -> None:
        self.watch: signature.Watch | None = None
        self._blobs = blobs
        self._state = state
        self._known: dict[str, list[int | str]] | None = None
        self._fresh: set[str] = set()
        """Paths whose rows are not saved yet."""

    def digest_leaf(self, path: Path) -> str:
        """Store a file or folder as a `File` or `Folder` artifact and return its digest.

        Raises:
            RecipeError: The path does not exist, cannot be read, or is neither a file nor a folder.
            StoreError: The store cannot be written.
        """
        name = os.path.abspath(path)
        state = _stat(name)
        if not stat.S_ISDIR(state.st_mode):
            return self._blobs.put(headers.file_header(*(self._recall(name, state) or self._read(name, state))))
        inside = list(self._walk(name))
        found = self._files(inside)
        start = len(name.rstrip(os.sep)) + 1
        tree = {inner[start:].replace(os.sep, "/"): found[inner] for inner, _ in inside}
        return self._blobs.put(headers.folder_header(tree))

    def save(self) -> None:
        """Save the digests of the files that were read, all or nothing; a read-only store stays unchanged."""
        if self._fresh:
            known = self._load()
            failpoints.reach("leaves.save")
            self._state.put(_KIND, {path: json.dumps(known[path]).encode() for path in self._fresh})
            self._fresh.clear()

    def _files(self, inside: list[tuple[str, os.stat_result]]) -> dict[str, tuple[str, int]]:
        """Digest and size of many files; new and changed ones are read in parallel, since hashing releases the GIL."""
        found = {path: self._recall(path, state) for path, state in inside}
        unread = [(path, state) for path, state in inside if found[path] is None]
        if len(unread) < _FEW:
            read = [self._read(path, state) for path, state in unread]
        else:
            from concurrent.futures import ThreadPoolExecutor  # slow to import

            with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
                read = list(pool.map(lambda one: self._read(*one), unread))
        known = {path: row for path, row in found.items() if row is not None}
        return known | {path: row for (path, _), row in zip(unread, read, strict=True)}

    def _recall(self, path: str, state: os.stat_result) -> tuple[str, int] | None:
        known = self._load().get(path)
        seen = signature.of(state)
        if known is None or tuple(known[:4]) != seen or not isinstance(known[4], int):
            return None
        if signature.is_proof(seen, known[4]):
            digest = str(known[5])
            if is_digest(digest) and self._blobs.holds(digest, seen[2]):
                self._note(path, seen)
                return digest, seen[2]
        return None

    def _read(self, path: str, state: os.stat_result) -> tuple[str, int]:
        if not stat.S_ISREG(state.st_mode) or (state.st_size == 0 and _is_made_up(path)):
            raise RecipeError(
                f"`{path}` is neither a file nor a folder",
                code="DXB-R303",
                hint="name a file or a folder, or take it out of the folder; copy a file of `/proc`",
            )
        for _ in range(_TRIES):
            before, now = signature.of(state), time.time_ns()
            self._note(path, before)
            try:
                digest, size = self._blobs.put_file(Path(path))
            except OSError as error:
                raise _unreadable(path, error) from None
            except StoreError as error:
                if error.code != "DXB-S105":
                    raise
                digest = ""
            state = _stat(path)
            if digest and signature.of(state) == before:
                self._load()[path] = [*before, now, digest]
                self._fresh.add(path)
                return digest, size
        raise RecipeError(
            f"`{path}` keeps changing while it is read",
            code="DXB-R304",
            hint="build again once the process that writes it has finished",
        )

    def _walk(self, root: str) -> Iterator[tuple[str, os.stat_result]]:
        """Files below `root` by name; links are followed."""
        stack: list[tuple[str, frozenset[tuple[int, int]]]] = [(root, frozenset())]
        while stack:
            folder, above = stack.pop()
            state = _stat(folder)
            identity = (state.st_dev, state.st_ino)
            if identity in above:
                raise _loop(folder)
            if self.watch is not None:
                self.watch.folder(folder)
            for inner in listed(folder):
                inner_state = _stat(inner.path)
                if stat.S_ISDIR(inner_state.st_mode):
                    stack.append((inner.path, above | {identity}))
                else:
                    yield inner.path, inner_state

    def _note(self, path: str, seen: signature.Signature) -> None:
        if self.watch is not None:
            self.watch.files.setdefault(path, seen)

    def _load(self) -> dict[str, list[int | str]]:
        if self._known is None:
            self._known = {}
            for path, data in self._state.all(_KIND).items():
                with suppress(ValueError):
                    row = digests.plain(data)
                    if isinstance(row, list) and len(row) == 6:
                        self._known[path] = row
        return self._known


def _stat(path: str) -> os.stat_result:
    try:
        state = os.stat(path)
    except OSError as error:
        raise _unreadable(path, error) from None
    _check_name(path)
    return state


def _is_made_up(path: str) -> bool:
    """Whether a file without a size has content or waits for some, as those of `/proc` that the system makes up."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _unreadable(path, error) from None
    try:
        return bool(os.read(descriptor, 1)) and os.fstat(descriptor).st_size == 0
    except BlockingIOError:
        return True
    except OSError as error:
        raise _unreadable(path, error) from None
    finally:
        os.close(descriptor)


def listed(folder: str) -> list[os.DirEntry[str]]:
    """Entries of a folder, sorted by name, without the names in `signature.IGNORED`.

    Raises:
        RecipeError: The folder cannot be read, or a name is not UTF-8.
    """
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if entry.name not in signature.IGNORED]
    except OSError as error:
        raise _unreadable(folder, error) from None
    for entry in found:
        _check_name(entry.path)
    return sorted(found, key=lambda entry: entry.name)


def _check_name(path: str) -> None:
    try:
        path.encode()
    except UnicodeEncodeError:
        shown = path.encode(errors="surrogateescape").decode(errors="replace")
        raise RecipeError(f"the name of `{shown}` is not UTF-8", code="DXB-R305", hint="rename it") from None


def _unreadable(path: str, error: OSError) -> RecipeError:
    if error.errno == errno.ELOOP:
        return _loop(path)
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        if os.path.islink(path):
            target = os.readlink(path)
            return RecipeError(
                f"`{path}` is a link to `{target}`, which is not there", code="DXB-R301", hint=f"ls -l {path}"
            )
        return RecipeError(
            f"there is no file or folder `{path}`",
            code="DXB-R301",
            facts={"nearest": disk_full.nearest(path)},
            hint=f"ls {disk_full.nearest(path)}",
        )
    return RecipeError(
        f"`{path}` cannot be read", code="DXB-R302", facts={"system says": error.strerror}, hint=f"ls -ld {path}"
    )


def _loop(path: str) -> RecipeError:
    return RecipeError(f"`{path}` is a link that leads back to itself", code="DXB-R303", hint=f"ls -l {path}")
