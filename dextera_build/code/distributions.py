"""Installed distributions: their versions and modules."""

from __future__ import annotations

import inspect
import os
from collections.abc import Iterable, Iterator
from functools import cache

_METADATA = {".dist-info": ("METADATA", "entry_points.txt"), ".egg-info": ("PKG-INFO", "entry_points.txt")}
"""Ending of a distribution's folder -> its files that hold the version and the entry points."""


def version_of(distribution: str) -> str | None:
    """Installed version of a distribution, or None."""
    import importlib.metadata

    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def metadata_files(folder: str, names: Iterable[str]) -> Iterator[str]:
    """Files, existing or not, that hold the versions and entry points of distributions; some change in place.

    Args:
        folder: A folder of the module search path.
        names: Names in it.
    """
    for name in names:
        files = _METADATA.get(os.path.splitext(name)[1])
        if files is not None:
            path = os.path.join(folder, name)
            yield from (os.path.join(path, file) for file in files) if os.path.isdir(path) else (path,)


@cache
def modules_of(package: str) -> frozenset[str]:
    """Top-level modules of an installed distribution."""
    import importlib.metadata

    try:
        found = importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        return frozenset()
    if listed := (found.read_text("top_level.txt") or "").split():
        return frozenset(listed)
    names = (inspect.getmodulename(file.parts[0]) or file.parts[0] for file in found.files or ())
    return frozenset(filter(str.isidentifier, names))
