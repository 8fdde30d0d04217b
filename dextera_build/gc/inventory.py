"""The contents of a store as its folders list them: blobs and results with size and last use, and leftovers."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.errors import StoreError
from dextera_build.store import entry as entries
from dextera_build.store import files
from dextera_build.store.blobs import listing
from dextera_build.store.store import Store

_DEPTH = 2
"""Number of levels below the store's folder at which unfinished files may be."""


@dataclass(frozen=True)
class Kept:
    """One result."""

    size: int
    """Bytes of the entry itself."""
    used: float
    """Last use (seconds since the epoch)."""
    needs: Mapping[str, int | None]
    """Digest -> size of the blobs that it names, see `entry.File`; empty if it cannot be read."""


@dataclass
class Inventory:
    """The contents of a store at one time."""

    blobs: dict[str, tuple[int, float]] = field(default_factory=dict)
    """Digest -> (bytes, last use)."""
    results: dict[str, Kept] = field(default_factory=dict)
    """Key -> result, if every blob that it needs is present; a bare result may lack bytes."""
    broken: dict[str, Kept] = field(default_factory=dict)
    """Key -> result that cannot be read or lacks a blob: a miss for every build."""
    keep: dict[str, tuple[int, float]] = field(default_factory=dict)
    """Key -> (bytes, last use) of the folders in which calls saved their progress."""

    def bytes(self) -> int:
        """Total size."""
        entries = (*self.results.values(), *self.broken.values())
        sizes = (*self.blobs.values(), *self.keep.values())
        return sum(entry.size for entry in entries) + sum(size for size, _ in sizes)


def read(store: Store) -> Inventory:
    """List everything; nothing is changed, and no use is noted."""
    found = Inventory()
    # Entries first: blobs of results published meanwhile are named by no entry, but are too young to be removed.
    held = dict(results(store))
    found.blobs = {digest: (size, used) for digest, size, used in listing(store.blobs.root)}
    for key, kept in held.items():
        there = (size in (None, found.blobs.get(name, (-1, 0))[0]) for name, size in kept.needs.items())
        (found.results if kept.needs and all(there) else found.broken)[key] = kept
    found.keep = {key: (size, used) for key, size, used in store.keep.all()}
    return found


def results(store: Store, known: frozenset[str] = frozenset()) -> Iterator[tuple[str, Kept]]:
    """Every result whose key is not in `known`."""
    names: dict[str, str] = {}
    for key, size, used in listing(store.actions.root):
        if key not in known:
            needs: dict[str, int | None] = {}
            with suppress(OSError, ValueError):
                found = entries.read(files.read(path_of(store, key)))
                if found.key == key:
                    needs = {names.setdefault(file.digest, file.digest): file.size for file in found.files}
            yield key, Kept(size, used, needs)


def path_of(store: Store, key: str) -> str:
    """The file of a result."""
    return f"{store.actions.root}/{key[:2]}/{key[2:]}"


def leftovers(store: Store) -> Iterator[tuple[str, int, float]]:
    """Unfinished files of killed processes, and damaged blobs in quarantine: (path, bytes, last change)."""
    aside = str(store.local / "quarantine")
    for folder in _folders(str(store.root), _DEPTH):
        for entry in _scan(folder):
            if folder == aside or entry.name.startswith(f"{files.TEMPORARY}-"):
                with suppress(FileNotFoundError):
                    state = entry.stat(follow_symlinks=False)
                    yield entry.path, state.st_size, state.st_mtime


def refuse_links(store: Store) -> None:
    """Refuse a store in which a link is in the place of a folder or a file: its target is not part of the store.

    Raises:
        StoreError: There is such a link.
    """
    places = [store.blobs.root, store.actions.root, store.root / "runs", store.local]
    links = [str(place) for place in places if place.is_symlink()]
    links += [entry.path for place in places for entry in _scan(str(place)) if entry.is_symlink()]
    if links:
        raise StoreError(
            "a link lies in the store, and what it leads to would be removed with what is unused",
            code="DXB-S403",
            facts={"link": links[0], "leads to": os.readlink(links[0])},
            hint=f"`rm {shlex.quote(links[0])}`; to keep a store elsewhere, link or name its whole folder",
        )


def _folders(root: str, depth: int) -> Iterator[str]:
    """A folder and those below it; links are not followed."""
    yield root
    for entry in _scan(root) if depth else ():
        if entry.is_dir(follow_symlinks=False):
            yield from _folders(entry.path, depth - 1)


def _scan(folder: str) -> list[os.DirEntry[str]]:
    try:
        return list(os.scandir(folder))
    except OSError:
        return []


def unwritable(store: Store) -> Path | None:
    """A read-only folder of the store, or None."""
    places = (store.blobs.root, store.actions.root, store.local, store.root)
    return next((place for place in places if place.is_dir() and not os.access(place, os.W_OK)), None)
