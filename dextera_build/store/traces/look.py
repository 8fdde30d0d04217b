"""Answers questions about a project's folder, and about nothing outside it; records the paths for the snapshot."""

from __future__ import annotations

import os
import posixpath
import stat
from pathlib import Path

from dextera_build import digest as digests
from dextera_build.errors import DxbError, RuleError
from dextera_build.store.statcache import StatCache
from dextera_build.store.traces import names
from dextera_build.store.traces.steps import NO, NONE, YES, is_plain

UNKNOWN = "?"
"""Returned if there is no answer."""


class Look:
    """A project's folder as calls see it that read by themselves.

    Args:
        root: The folder.
        leaves: Digests files; what watches it is told of folders and missing files, too.
        store: The folder of the store, which is no part of the project wherever it lies.
    """

    def __init__(self, root: Path, leaves: StatCache, store: Path) -> None:
        self._root = os.path.abspath(root)
        self._real = os.path.realpath(root)
        self._store = os.path.realpath(store)
        self._leaves = leaves
        self._safe: dict[str, bool] = {}
        """Folder below the root -> whether it lies inside."""

    def answer(self, kind: str, name: str) -> str:
        """What a call would be told now; see `steps`.

        Raises:
            RuleError: The name leads out of the project.
            RecipeError: Something there cannot be read.
        """
        if kind == "names":
            return digests.of_value(self.names(name))
        if kind == "there":
            return YES if self._state(name) is not None else NO
        state = self._state(name)
        is_file = state is not None and not stat.S_ISDIR(state.st_mode)
        return self._leaves.digest_leaf(Path(self.path(name))) if is_file else NONE

    def answer_or_unknown(self, kind: str, name: str) -> str:
        """As `answer`, but `UNKNOWN` if there is none."""
        try:
            return self.answer(kind, name)
        except DxbError:
            return UNKNOWN

    def names(self, pattern: str) -> list[str]:
        """Files below the project that match a pattern, sorted.

        Raises:
            RuleError: The pattern leads out of the project.
            RecipeError: A folder cannot be read.
        """
        if not is_plain(pattern):
            raise _outside(pattern)
        return names.matching(self._root, pattern, self)

    def path(self, name: str) -> str:
        """Where a file or folder of the project lies.

        Raises:
            RuleError: The name leads out of the project.
        """
        if not is_plain(name):
            raise _outside(name)
        path = os.path.join(self._root, name)
        if not self._inside(name) or (os.path.islink(path) and not self._is_ours(os.path.realpath(path))):
            raise _outside(name, os.path.realpath(path))
        return path

    def place(self, kind: str, name: str) -> str:
        """The path that an answer depends on; for a pattern, the folder that holds every match."""
        below = names.base(name) if kind == "names" else name
        return os.path.join(self._root, below) if below else self._root

    def _state(self, name: str) -> os.stat_result | None:
        path = self.path(name)
        if self._leaves.watch is not None:
            self._leaves.watch.file(path)
        try:
            return os.stat(path)
        except OSError:
            return None

    def enter(self, folder: str) -> bool:
        """Whether a folder may be listed; the store's may not."""
        path = os.path.join(self._root, folder) if folder else self._root
        if folder and not self._is_ours(os.path.realpath(path)):
            if os.path.realpath(path) == self._store:
                return False
            raise _outside(folder, os.path.realpath(path))
        if self._leaves.watch is not None:
            self._leaves.watch.file(path)
            self._leaves.watch.folder(path)
        return True

    def link(self, path: str) -> None:
        """Refuse a link that leads out of the project, and watch what it leads to."""
        self._state(path)

    def _inside(self, name: str) -> bool:
        """Whether the folder that a name lies in is in the project; asked once."""
        folder = posixpath.dirname(name)
        if folder not in self._safe:
            real = os.path.realpath(os.path.join(self._root, folder))
            if not folder or os.path.isdir(real):
                self._safe[folder] = self._is_ours(real)
            else:
                return self._is_ours(real)
        return self._safe[folder] and os.path.join(self._real, name) != self._store

    def _is_ours(self, real: str) -> bool:
        inside = real == self._real or real.startswith(f"{self._real.rstrip('/')}/")
        return inside and real != self._store and not real.startswith(f"{self._store}/")


def _outside(name: str, real: str = "") -> RuleError:
    return RuleError(
        f"`{name}` is not in the project's folder, and a rule reads nothing else",
        code="DXB-B351",
        facts={"leads to": real} if real else {},
        hint="name it from the project's folder, without `..`; copy other files into it, or make them inputs",
    )
