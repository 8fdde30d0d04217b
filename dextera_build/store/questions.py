"""Answers questions about a project's folder, never about paths outside it, and records the questions of a call.

Patterns: `*`, `?` and `[...]` match within one name, `**` alone between slashes any number of folders. A name with a
leading dot matches only a pattern with a leading dot. Links to files count as files; `**` does not follow links.
"""

from __future__ import annotations

import fnmatch
import os
import posixpath
import re
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

from dextera_build import digest as digests
from dextera_build.errors import DxbError, RuleError
from dextera_build.store.statcache import StatCache, listed
from dextera_build.store.traces import NO, NONE, YES, is_plain

UNKNOWN = "?"
"""Returned if there is no answer."""

_Step: TypeAlias = tuple[str, tuple[str, ...]]
"""A folder below the root, and the remaining parts of a pattern to match there."""


class Look:
    """A project's folder as seen by calls with discovered inputs.

    Args:
        root: The folder.
        leaves: Digests files; its `watch` also notes folders and missing files.
        store: The folder of the store, which is never part of the project, even if it is inside.
    """

    def __init__(self, root: Path, leaves: StatCache, store: Path) -> None:
        self._root = os.path.abspath(root)
        self._real = os.path.realpath(root)
        self._store = os.path.realpath(store)
        self._leaves = leaves

    def answer(self, kind: str, name: str) -> str:
        """The current answer to a question; see `traces`.

        Raises:
            RuleError: The name leads out of the project.
            RecipeError: A file or folder cannot be read.
        """
        if kind == "names":
            return digests.of_value(self.names(name))
        state = self._state(name)
        if kind == "there":
            return YES if state is not None else NO
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
        found: set[str] = set()
        stack: list[_Step] = [("", tuple(pattern.split("/")))]
        seen = set(stack)
        while stack:
            fresh = [step for step in self._follow(*stack.pop(), found) if step not in seen]
            seen.update(fresh)
            stack += fresh
        return sorted(found)

    def path(self, name: str) -> str:
        """Path of a file or folder of the project.

        Raises:
            RuleError: The name leads out of the project.
        """
        path = os.path.join(self._root, name)
        real = os.path.realpath(path) if is_plain(name) else ""
        if not self._is_ours(real):
            raise _outside(name, real)
        return path

    def _state(self, name: str) -> os.stat_result | None:
        path = self.path(name)
        if self._leaves.watch is not None:
            self._leaves.watch.file(path)
        try:
            return os.stat(path)
        except OSError:
            return None

    def _follow(self, folder: str, parts: tuple[str, ...], found: set[str]) -> Iterator[_Step]:
        """The next steps of a walk; adds matching files to `found`."""
        part, rest = parts[0], parts[1:]
        if rest and not any(sign in part for sign in "*?["):
            yield _join(folder, part), rest  # need not be listed
            return
        if part == "**" and rest:
            yield folder, rest
        path = os.path.join(self._root, folder) if folder else self._root
        if not self._may_list(folder, path):
            return
        deep = part == "**"
        accepts = re.compile(fnmatch.translate("*" if deep else part)).match
        for entry in listed(path) if os.path.isdir(path) else ():
            hidden = entry.name.startswith(".") and not part.startswith(".")
            if hidden or not accepts(entry.name):
                continue
            name = _join(folder, entry.name)
            if entry.is_symlink():
                self._state(name)  # refuses a link that leads out of the project
            if deep and entry.is_dir(follow_symlinks=False):
                yield name, parts
            elif rest and not deep and entry.is_dir():
                yield name, rest
            if not rest and entry.is_file():
                found.add(name)

    def _may_list(self, folder: str, path: str) -> bool:
        """Whether a folder may be listed; the store's may not."""
        real = os.path.realpath(path)
        if folder and not self._is_ours(real):
            if real == self._store:
                return False
            raise _outside(folder, real)
        if self._leaves.watch is not None:
            self._leaves.watch.file(path)
            self._leaves.watch.folder(path)
        return True

    def _is_ours(self, real: str) -> bool:
        inside = real == self._real or real.startswith(f"{self._real.rstrip('/')}/")
        return inside and real != self._store and not real.startswith(f"{self._store}/")


class Recording:
    """Answers the questions of one call and records them in order, each once.

    Args:
        look: Provides the answers.
    """

    def __init__(self, look: Look) -> None:
        self._look = look
        self._guard = threading.RLock()
        self.listings: dict[str, list[str]] = {}
        """Pattern -> files that match."""
        self._answers: dict[tuple[str, str], str] = {}
        self.error: DxbError | None = None
        """Why a question had no answer; the call then fails, even if it catches the error."""
        self._closed = False
        """Whether the call saved progress, which depends on all files read so far."""

    @property
    def steps(self) -> list[list[str]]:
        """Questions and answers."""
        return [[kind, name, answer] for (kind, name), answer in self._answers.items()]

    def close(self) -> str:
        """Answer no further questions; return the digest of the answers so far."""
        self._closed = True
        return digests.of_value(self.steps)

    def digest_of(self, path: str) -> str:
        """Digest of the `File` at `path`.

        Raises:
            DxbError: It does not exist, cannot be read, or is outside the project.
        """
        name = posixpath.normpath(path)
        answer = self._ask("file", name, lambda: self._look.answer("file", name))
        if answer == NONE:
            raise self._fail(
                RuleError(
                    f"there is no file `{name}` in the project's folder",
                    code="DXB-B352",
                    hint=f"`ctx.exists({name!r})` checks first, `ctx.glob` lists files",
                )
            )
        return answer

    def exists(self, path: str) -> bool:
        """Whether there is a file or folder at `path`."""
        name = posixpath.normpath(path)
        return self._ask("there", name, lambda: self._look.answer("there", name)) == YES

    def glob(self, pattern: str) -> list[str]:
        """Files that match a pattern, sorted."""
        name = posixpath.normpath(pattern)

        def listed() -> str:
            self.listings[name] = self._look.names(name)
            return digests.of_value(self.listings[name])

        self._ask("names", name, listed)
        return list(self.listings[name])

    def _ask(self, kind: str, name: str, answer: Callable[[], str]) -> str:
        with self._guard:
            if (kind, name) in self._answers:
                return self._answers[kind, name]
            if self._closed:
                raise self._fail(
                    RuleError(
                        f"`{name}` is read after `ctx.keep` was used",
                        code="DXB-B353",
                        hint="read files first: saved progress may depend only on files read before",
                    )
                )
            try:
                told = answer()
            except DxbError as error:
                raise self._fail(error) from None
            self._answers[kind, name] = told
            return told

    def _fail(self, error: DxbError) -> DxbError:
        self.error = self.error or error
        return error


def _outside(name: str, real: str = "") -> RuleError:
    return RuleError(
        f"`{name}` is outside the project's folder, and rules read files only inside it",
        code="DXB-B351",
        facts={"leads to": real} if real else {},
        hint="name it from the project's folder, without `..`; copy other files into it, or make them inputs",
    )


def _join(folder: str, name: str) -> str:
    return f"{folder}/{name}" if folder else name
