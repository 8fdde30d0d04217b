"""Modules in the folder of a program that its sources import, declared or not."""

from __future__ import annotations

import ast
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

Import = tuple[int, tuple[str, ...], tuple[str, ...]]
"""Level, parts of the module's name, and the names that are imported from it."""


def imported(files: Iterable[Path], folders: Sequence[Path], names: Sequence[str] = ()) -> tuple[set[Path], set[Path]]:
    """Sources that a program imports from its own folders, transitively, and missing ones that it would import.

    Args:
        files: Its files; those that are not Python, or of another version of it, import nothing.
        folders: Folders that its Python searches first.
        names: Modules that its command names with `-m`.
    """
    begun = (place for name in names for place in _places((0, tuple(name.split(".")), ("__main__",)), folders))
    todo = [*(file for file in files if file.suffix == ".py"), *begun]
    found, missing = set[Path](), set[Path]()
    while todo:
        place = todo.pop()
        if place in found or place in missing:
            continue
        if place.is_file():
            found.add(place)
            todo += _imported(place, folders)
        else:
            missing.add(place)
    return found, missing


def _imported(file: Path, folders: Sequence[Path]) -> Iterator[Path]:
    """Where the modules may lie that a source imports."""
    data = b""
    with suppress(OSError):  # reading it for its digest raises the error
        data = file.read_bytes()
    for each in _imports(data):
        yield from _places(each, file.parents[each[0] - 1 : each[0]] if each[0] else folders)


def _places(imports: Import, folders: Sequence[Path]) -> Iterator[Path]:
    """Where the modules of an import may lie; packages above a module run, too."""
    level, parts, names = imports
    modules = [parts[:count] for count in range(1, len(parts) + 1)] + [(*parts, name) for name in names]
    for folder in folders:
        if level:
            yield folder / "__init__.py"
        for inner in modules:
            yield folder.joinpath(*inner, "__init__.py")
            yield folder.joinpath(*inner[:-1], f"{inner[-1]}.py")


@lru_cache(maxsize=4096)
def _imports(data: bytes) -> tuple[Import, ...]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of invalid escapes; the program shows them
            tree = ast.parse(data)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return ()
    found = list[Import]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(0, tuple(alias.name.split(".")), ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parts = tuple(node.module.split(".")) if node.module else ()
            found.append((node.level, parts, tuple(alias.name for alias in node.names if alias.name != "*")))
    return tuple(found)
