"""Files of the project that a rule opens although no input names them: editing them makes nothing stale."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Container, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from dextera_build.code.modules import PACKAGE

_CODE = (".py", ".pyc", ".so")
_OF_DXB = {"dxb.toml", "dxb.lock", "pyproject.toml", "recipes"}
"""Files that dxb itself reads in a project."""
_listening: list[set[str]] = []
_on_import: dict[str, set[str]] = {}
"""Rule -> files that were opened when it was imported, once per process."""


@contextmanager
def opened() -> Iterator[set[str]]:
    """Yield a set that gets the path of each file that Python opens for reading; libraries may open others in C."""
    _listen()
    found = set[str]()
    _listening.append(found)
    try:
        yield found
    finally:
        _listening.pop()


def imported(rule: str, files: set[str]) -> set[str]:
    """All files that were opened when a rule was imported, now or for an earlier call."""
    _on_import.setdefault(rule, set()).update(files)
    return _on_import[rule]


def unnamed(files: set[str], project: Path, store: Path, asked: Container[str] = ()) -> list[str]:
    """Those of the files that are data of the project, by their path in it.

    Args:
        files: Absolute paths.
        project: The project's folder.
        store: The store's folder.
        asked: Paths in the project that the call requested from its context.
    """
    weights = filter(None, os.environ.get("DXB_MODELS", "").split(os.pathsep))  # the key holds their digests
    temporary = tempfile.gettempdir()
    known: list[str | Path] = [PACKAGE, store, *weights, *([] if project.is_relative_to(temporary) else [temporary])]
    found = []
    for file in sorted(files):
        if not file.startswith(f"{project}{os.sep}") or file.endswith(_CODE) or not os.path.isfile(file):
            continue
        name = os.path.relpath(file, project)
        parts = Path(name).parts
        is_installed = any(part in ("site-packages", "dist-packages") or part.endswith("-info") for part in parts)
        is_of_dxb = parts[0] in _OF_DXB or any(Path(file).is_relative_to(folder) for folder in known)
        if not (is_installed or is_of_dxb or name in asked or name.startswith(".")):
            found.append(name)
    return found


@cache
def _listen() -> None:
    sys.addaudithook(_hear)


def _hear(event: str, facts: tuple[object, ...]) -> None:
    if event == "open" and _listening:
        path, _, flags = facts
        if isinstance(path, str) and isinstance(flags, int) and flags & os.O_ACCMODE == os.O_RDONLY:
            _listening[-1].add(os.path.abspath(path))
