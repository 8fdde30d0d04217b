"""Which distributions a rule declares, and what it imports beside them."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

_WITH_DXB = {"PIL", "annotated_types", "numpy", "pydantic", "pydantic_core", "typing_extensions", "yaml"}
"""What every installation of dxb has."""


def undeclared(rule: str, imported: Mapping[str, Path], packages: Iterable[str]) -> dict[str, str]:
    """Top-level module -> what to say of it, for those whose version no key holds.

    Args:
        rule: The rule whose code imports them.
        imported: Top-level modules that are not first-party -> a file that imports them.
        packages: Distributions that the rule and its backend declare.
    """
    known = sys.stdlib_module_names | _WITH_DXB | {package.replace("-", "_").lower() for package in packages}
    unknown = [top for top in imported if top not in known]
    provided = {top for package in packages for top in _modules(package)} if unknown else set()
    return {
        top: f"{rule} imports `{top}`, which is neither code of the project nor a package that the rule declares: "
        f"another version of it makes nothing stale; add its distribution to `packages` ({imported[top]})"
        for top in unknown
        if top not in provided
    }


@cache
def _modules(package: str) -> frozenset[str]:
    """Top-level modules of an installed distribution."""
    import importlib.metadata

    try:
        found = importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        return frozenset()
    listed = (found.read_text("top_level.txt") or "").split()
    return frozenset(listed or [file.parts[0].removesuffix(".py") for file in found.files or ()])
