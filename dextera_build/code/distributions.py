"""Installed distributions: their versions and modules."""

from __future__ import annotations

import inspect
from functools import cache


def version_of(distribution: str) -> str | None:
    """Installed version of a distribution, or None."""
    import importlib.metadata

    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


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
