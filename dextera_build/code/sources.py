"""What a machine needs of a project's code to run its rules, and what must be the same there: for workers elsewhere."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from pathlib import Path

from dextera_build import digest
from dextera_build.code.loader import PACKAGE, Library, bundled, version_of

_SETTINGS = ("dxb.toml", "pyproject.toml")


def files(project: Path) -> dict[str, Path]:
    """Name -> file of all that a worker needs from the project's folder.

    These are all files below `rules/`, the project's own modules that these import, and its settings.
    """
    library = Library(project)
    rules = project / "rules"
    found = {name: project / name for name in _SETTINGS if (project / name).is_file()}
    own = list(_below(rules))
    library.code.of(*(file for file in own if file.suffix == ".py"))
    for file in (*own, *library.code.files()):
        if file.is_relative_to(project) and not file.is_relative_to(PACKAGE):
            found[file.relative_to(project).as_posix()] = file
    return found


def versions(packages: Mapping[str, str]) -> dict[str, str]:
    """What must be the same on every machine: name -> version or digest.

    Args:
        packages: Distribution -> version, of those that the rules of a build declare.
    """
    major, minor, _ = platform.python_version_tuple()
    return {"dextera-build": _own_code(), "python": f"{major}.{minor}", **packages}


def differences(wanted: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """What of `wanted`, which `versions` gave elsewhere, is otherwise here: name -> (there, here)."""
    packages = {name: version_of(name) or "none" for name in wanted if name not in ("dextera-build", "python")}
    here = versions(packages)
    return {name: (there, here[name]) for name, there in wanted.items() if here[name] != there}


def _own_code() -> str:
    """Digest of dxb itself, with the rules that come with it."""
    folders = {"dextera_build": PACKAGE, "rules": bundled("rules")}
    listed = [
        [f"{name}/{file.relative_to(folder).as_posix()}", digest.of_bytes(file.read_bytes())]
        for name, folder in folders.items()
        for file in _below(folder)
        if file.suffix == ".py" and "_bundled" not in file.relative_to(folder).parts
    ]
    return digest.of_value(listed)[:12]


def _below(folder: Path) -> Iterator[Path]:
    for file in sorted(folder.rglob("*")):
        inner = file.relative_to(folder).parts
        if file.is_file() and not any(part.startswith(".") or part == "__pycache__" for part in inner):
            yield file
