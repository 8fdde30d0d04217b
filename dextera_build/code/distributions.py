"""Installed distributions: their versions and modules; and the versions of Python and the platform."""

from __future__ import annotations

import inspect
import os
import re
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.store import signature

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from dextera_build.store.signature import Watch

RUNTIME = {
    "platform": f"{sys.platform}-{os.uname().machine}",
    "python": f"{sys.version_info.major}.{sys.version_info.minor}",
}
"""Part of every key, because `sum`, `random` and `math.sin` give other bits elsewhere."""
_RECORDS = ("top_level.txt", "RECORD")
"""Files that list the modules of a distribution; the first may be absent or empty."""

_VERSION = re.compile(r"^version: *(\S+) *$", re.IGNORECASE | re.MULTILINE)
"""The version in the metadata of a distribution."""
_METADATA = {".dist-info": ("METADATA", "entry_points.txt"), ".egg-info": ("PKG-INFO", "entry_points.txt")}
"""Ending of a distribution's folder -> its files that hold the version and the entry points."""
_ENDINGS = tuple(_METADATA)


def version_of(distribution: str) -> str | None:
    """Installed version of a distribution, or of a name in `RUNTIME`; None if there is none."""
    import importlib.metadata

    if distribution in RUNTIME:
        return RUNTIME[distribution]
    try:
        found = importlib.metadata.distribution(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None
    # `found.version` parses all of the metadata as a message, which takes ten times as long; a plan asks for hundreds.
    head = (found.read_text("METADATA") or found.read_text("PKG-INFO") or "").partition("\n\n")[0]
    line = _VERSION.search(head)
    return line[1] if line else found.version


def normal(distribution: str) -> str:
    """The one spelling of a distribution's name: `PyYAML` is `pyyaml`, `usd_core` is `usd-core`."""
    return re.sub(r"[-_.]+", "-", distribution).lower()


def providers(modules: Iterable[str]) -> dict[str, frozenset[str]]:
    """Top-level module -> the installed distributions that have it; several may share one."""
    found = _installed()
    return {module: frozenset(found.get(module, ())) for module in modules}


def _installed() -> dict[str, set[str]]:
    """Top-level module -> the installed distributions that have it.

    As `importlib.metadata.packages_distributions`, which takes twenty times as long.
    """
    found: defaultdict[str, set[str]] = defaultdict(set)
    for folder in sys.path:
        place = folder or os.getcwd()
        for module, names in _providers(place, _changed_ns(place)).items():
            found[module] |= names
    return dict(found)


@lru_cache(maxsize=16)
def _providers(folder: str, changed_ns: int) -> dict[str, set[str]]:
    """Top-level module -> the distributions in one folder of the module search path that have it.

    Args:
        folder: The folder.
        changed_ns: The time of its last change; 0: there is none.
    """
    found: defaultdict[str, set[str]] = defaultdict(set)
    for name in os.listdir(folder) if changed_ns else ():
        stem, ending = os.path.splitext(name)
        if ending in _METADATA:
            for module in _listed(os.path.join(folder, name)):
                found[module].add(normal(stem.partition("-")[0]))
    return dict(found)


def _listed(folder: str) -> set[str]:
    """The top-level modules that the metadata of a distribution lists."""
    for record in _RECORDS:
        with suppress(OSError):
            names = {line.partition("/")[0] for line in Path(folder, record).read_text("utf-8", "replace").splitlines()}
            if names:
                return {inspect.getmodulename(name.partition(",")[0]) or name for name in names}
    return set()


def _changed_ns(folder: str) -> int:
    """When the names in a folder changed last; 0 if it is none."""
    with suppress(OSError):
        return os.stat(folder).st_mtime_ns if os.path.isdir(folder) else 0
    return 0


def metadata_files(folder: str, names: Iterable[str]) -> Iterator[str]:
    """Files, existing or not, that hold the versions and entry points of distributions; some change in place.

    Args:
        folder: A folder of the module search path.
        names: Names in it.
    """
    for name in names:
        if name.endswith(_ENDINGS):
            path = os.path.join(folder, name)
            files = _METADATA[os.path.splitext(name)[1]]
            yield from (f"{path}{os.sep}{file}" for file in files) if os.path.isdir(path) else (path,)


def entry_points(group: str) -> tuple[EntryPoint, ...]:
    """Entry points of a group of installed distributions, read again only where their files may have changed."""
    began_ns, state = time.time_ns(), tuple(_entry_files())
    if all(seen is None or signature.is_proof(seen, began_ns) for _, seen in state):
        return _entry_points(group, state)
    return _entry_points.__wrapped__(group, state)


@lru_cache(maxsize=8)
def _entry_points(group: str, state: tuple[tuple[str, signature.Signature | None], ...]) -> tuple[EntryPoint, ...]:
    import importlib.metadata  # slow to import, and not every command needs rules

    return tuple(importlib.metadata.entry_points(group=group))


def _entry_files() -> Iterator[tuple[str, signature.Signature | None]]:
    """Files, existing or not, that hold the entry points of distributions, in the order of the search."""
    for entry in sys.path:
        folder = entry or os.getcwd()
        try:
            names = [name for name in os.listdir(folder) if name.endswith(_ENDINGS)]
        except OSError:  # an archive, or none
            yield folder, signature.look(folder)
            continue
        for name in sorted(names):
            path = os.path.join(folder, name, "entry_points.txt")
            yield path, signature.look(path)


def note_packages(watch: Watch, *, doubts: bool = False) -> None:
    """Add importable modules and installed packages to a watch; `doubts`: some may have been imported before."""
    for entry in sys.path:
        folder = entry or os.getcwd()
        watch.modules(folder)
        if doubts and os.path.exists(folder):
            watch.doubt(folder, was_read=False)
    for folder, names in watch.paths.items():
        for path in metadata_files(folder, names or ()):
            watch.file(path)


def modules_of(package: str) -> frozenset[str]:
    """Top-level modules of an installed distribution."""
    wanted = normal(package)
    return frozenset(module for module, names in _installed().items() if wanted in names and module.isidentifier())
