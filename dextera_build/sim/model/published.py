"""Files of robots in installed distributions, which are read but never imported, and their licences."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeVar

from dextera_build.errors import RuleError, did_you_mean, install_extra

LICENCES = ("LICENSE*", "LICENCE*", "COPYING*", "NOTICE*")
"""Names of files that state a licence."""
Content = TypeVar("Content")


def located(distribution: str, path: str) -> Path:
    """A file or folder of a distribution.

    Raises:
        RuleError: The distribution is not installed, or has no such path.
    """
    try:
        found = importlib.metadata.distribution(distribution)
    except importlib.metadata.PackageNotFoundError:
        raise RuleError(f"`{distribution}` is not installed", code="DXB-B213", hint=install_extra("robots")) from None
    place = Path(str(found.locate_file(path)))
    if not place.exists():
        above = next(each for each in place.parents if each.exists())
        raise RuleError(
            f"`{distribution}` {found.version} has no `{path}`",
            code="DXB-B213",
            hint=did_you_mean(place.name, [each.name for each in above.iterdir()]) or install_extra("robots"),
        )
    return place


def files(distribution: str, folder: str, only: Sequence[str] = ()) -> dict[str, bytes]:
    """Path in a folder of a distribution -> content, with the licence that applies.

    Args:
        distribution: Its name.
        folder: Path in its installation folder.
        only: Patterns of paths in the folder, `*` for any text; empty: all.

    Raises:
        RuleError: There is no such folder, or a pattern fits nothing.
    """
    top = located(distribution, folder)
    paths = {str(each.relative_to(top)): each for each in sorted(top.rglob("*")) if each.is_file()}
    for pattern in only:
        if not any(fnmatchcase(path, pattern) for path in paths):
            raise RuleError(
                f"`{folder}` has nothing like `{pattern}`", code="DXB-B213", hint=did_you_mean(pattern, paths)
            )
    chosen = [path for path in paths if not only or any(fnmatchcase(path, pattern) for pattern in only)]
    return {**licence(distribution, top), **{path: paths[path].read_bytes() for path in chosen}}


def licence(distribution: str, place: Path) -> dict[str, bytes]:
    """Name -> text of the licence files nearest to a path in a distribution, else of the distribution itself."""
    installed = importlib.metadata.distribution(distribution)
    top = Path(str(installed.locate_file("")))
    for folder in (place, *place.parents):
        if folder == top:
            break
        if found := stated({each.name: each for each in folder.iterdir() if each.is_file()} if folder.is_dir() else {}):
            return {name: path.read_bytes() for name, path in found.items()}
    own = {Path(str(each)).name: Path(str(installed.locate_file(each))) for each in installed.files or ()}
    return {name: path.read_bytes() for name, path in stated(own).items() if path.is_file()}


def stated(found: Mapping[str, Content]) -> dict[str, Content]:
    """The licence files of a folder."""
    return {name: each for name, each in found.items() if any(fnmatchcase(name, pattern) for pattern in LICENCES)}
