"""Folders in which long calls save their progress: one per key, on this machine only.

Saved progress enters no key and no result: the call resumes from it in the next build, and the folder is removed when
the call's result is in the store.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from dextera_build.store import failpoints, files


class Keep:
    """Folders by key below one folder.

    Args:
        root: The folder; created when a call first requests its own.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, key: str) -> Path:
        """The folder of a key, which need not exist."""
        return self.root / key

    def drop(self, key: str) -> None:
        """Remove the folder of a key atomically: others see all of it or none, even after a kill."""
        if not os.path.lexists(f"{self.root}/{key}"):  # the common case, which must be fast
            return
        aside = self.root / f"{files.TEMPORARY}-{files.unique()}"
        # A read-only store keeps it; nothing can be published there either.
        with suppress(OSError):
            os.rename(self.path(key), aside)
            failpoints.reach("keep.aside")
            files.remove(str(aside))

    def all(self) -> Iterator[tuple[str, int, float]]:
        """Every folder as (key, bytes, last change)."""
        for folder in sorted(self.root.iterdir()) if self.root.is_dir() else ():
            if not folder.name.startswith(files.TEMPORARY):
                yield folder.name, *_looked_at(folder)


def _looked_at(folder: Path) -> tuple[int, float]:
    """Bytes and last change of everything below a folder."""
    if folder.is_symlink():
        return 0, folder.lstat().st_mtime
    size, changed = 0, 0.0
    for place, _, names in os.walk(folder):
        for name in (".", *names):
            with suppress(OSError):
                state = os.lstat(os.path.join(place, name))
                size += state.st_size if name != "." else 0
                changed = max(changed, state.st_mtime)
    return size, changed
