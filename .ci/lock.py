"""Print the lock: every distribution that the extras of `make setup` and the dependency groups need, as installed."""

from __future__ import annotations

import importlib.metadata
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

EXTRAS = ("twin", "learn", "recordings", "share", "cloud", "models", "view", "teleop", "serve", "ros", "zenoh", "warp")
OLDEST = "3.11.2"
"""The oldest interpreter that the lock has to serve: Debian 12's."""


def wanted() -> list[Requirement]:
    """Requirements that pyproject.toml states directly."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text())
    texts = [*project["build-system"]["requires"], *project["project"]["dependencies"]]
    for extra in EXTRAS:
        texts += project["project"]["optional-dependencies"][extra]
    for group in project["dependency-groups"].values():
        texts += group
    return [Requirement(text) for text in texts]


def installed(requirements: list[Requirement]) -> dict[str, str]:
    """Name -> version of the requirements and of all that they need."""
    found: dict[str, str] = {}
    done: set[tuple[str, str]] = set()
    stack = [(need, extra) for need in requirements for extra in ("", *need.extras)]
    while stack:
        need, extra = stack.pop()
        if (need.name, extra) in done:
            continue
        done.add((need.name, extra))
        distribution = importlib.metadata.distribution(need.name)
        if OLDEST not in SpecifierSet(distribution.metadata["Requires-Python"] or ""):
            sys.exit(f"{need.name} {distribution.version} does not run on Python {OLDEST}: install an older one first")
        # `2.13.0+cpu` is one build of 2.13.0; the machine chooses the build.
        found[canonicalize_name(need.name)] = distribution.version.partition("+")[0]
        stack += list(needed_by(distribution, extra))
    return found


def needed_by(distribution: importlib.metadata.Distribution, extra: str) -> Iterator[tuple[Requirement, str]]:
    """What one distribution needs on this machine, with each extra that it asks for."""
    for text in distribution.requires or []:
        need = Requirement(text)
        if need.marker is None or need.marker.evaluate({"extra": extra}):
            yield from ((need, name) for name in ("", *need.extras))


if __name__ == "__main__":
    for name, version in sorted(installed(wanted()).items()):
        print(f"{name}=={version}")
