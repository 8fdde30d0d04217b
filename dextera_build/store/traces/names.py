"""Files below a folder whose names match a pattern, and which folders had to be looked at for that.

`*`, `?` and `[...]` stand for characters of one name, `**` alone between slashes for any number of folders. A name that
begins with a dot is matched only by a pattern that does. Links to files count as files; `**` does not follow links.
"""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Iterator
from typing import Protocol

from dextera_build.errors import RecipeError
from dextera_build.store import signature


class Visitor(Protocol):
    """Is told where the walk goes; paths are below the root, "" is the root itself."""

    def enter(self, folder: str) -> bool:
        """A folder is about to be listed; False: it is passed over."""
        ...

    def link(self, path: str) -> None:
        """A link is about to be followed."""
        ...


def matching(root: str, pattern: str, visitor: Visitor) -> list[str]:
    """Paths below `root` of the files that match, sorted.

    Raises:
        DxbError: The visitor refuses to go somewhere.
        RecipeError: A folder cannot be read, or a name is not UTF-8.
    """
    found: set[str] = set()
    stack = [("", tuple(pattern.split("/")))]
    seen = set(stack)
    while stack:
        folder, parts = stack.pop()
        for fresh in _step(root, folder, parts, visitor, found):
            if fresh not in seen:
                seen.add(fresh)
                stack.append(fresh)
    return sorted(found)


def base(pattern: str) -> str:
    """The folder below which all must lie that matches."""
    parts = pattern.split("/")
    plain = next((place for place, part in enumerate(parts) if _is_wild(part)), len(parts))
    return "/".join(parts[: min(plain, len(parts) - 1)])


def _step(
    root: str, folder: str, parts: tuple[str, ...], visitor: Visitor, found: set[str]
) -> Iterator[tuple[str, tuple[str, ...]]]:
    part, rest = parts[0], parts[1:]
    if rest and not _is_wild(part):
        yield _join(folder, part), rest  # need not be listed
        return
    if part == "**" and rest:
        yield folder, rest
    if not visitor.enter(folder):
        return
    deep = part == "**"
    accepts = re.compile(fnmatch.translate("*" if deep else part)).match
    for entry in _inside(root, folder):
        hidden = entry.name.startswith(".") and not part.startswith(".")
        if hidden or not accepts(entry.name):
            continue
        path = _join(folder, entry.name)
        if entry.is_symlink():
            visitor.link(path)
        if deep and entry.is_dir(follow_symlinks=False):
            yield path, parts
        elif rest and not deep and entry.is_dir():
            yield path, rest
        if not rest and entry.is_file():
            found.add(path)


def _inside(root: str, folder: str) -> list[os.DirEntry[str]]:
    path = os.path.join(root, folder)
    try:
        with os.scandir(path) as entries:
            found = [entry for entry in entries if entry.name not in signature.IGNORED]
        for entry in found:
            entry.name.encode()
    except (FileNotFoundError, NotADirectoryError):
        return []
    except UnicodeEncodeError:
        raise RecipeError(f"a name in `{path}` is not UTF-8", code="DXB-R305", hint="rename it") from None
    except OSError as error:
        raise RecipeError(
            f"`{path}` cannot be read", code="DXB-R302", facts={"system says": error.strerror}, hint=f"ls -ld {path}"
        ) from None
    return found


def _is_wild(part: str) -> bool:
    return any(sign in part for sign in "*?[")


def _join(folder: str, name: str) -> str:
    return f"{folder}/{name}" if folder else name
