"""Trees of files by relative path: written below a folder, from memory, from other files or from a store."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from dextera_build.artifacts.core.labels import path_fault
from dextera_build.artifacts.core.lazy import place
from dextera_build.errors import StoreError


def write(files: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write files below `folder`; the first path is the topmost file, first by name."""
    paths = _paths(files, folder)
    for name, path in paths.items():
        place(files, name, path)
    return list(paths.values())


def restore(blobs: Mapping[str, str], copy: Callable[[str, Path], object], folder: Path) -> list[Path]:
    """Write blobs below `folder` in parallel, without holding them in memory.

    Args:
        blobs: Relative path -> digest.
        copy: Writes a blob to a path.
        folder: Target folder.
    """
    from concurrent.futures import ThreadPoolExecutor  # slow to load

    paths = _paths(blobs, folder)
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda name: copy(blobs[name], paths[name]), paths))
    return list(paths.values())


def _paths(names: Mapping[str, object], folder: Path) -> dict[str, Path]:
    """Name -> path below `folder`, the topmost first; creates the folders."""
    for name in names:
        wrong = path_fault(name)
        if wrong:
            raise StoreError(f"`{name}` cannot be written below `{folder}`: {wrong}", code="DXB-S404")
    paths = {name: folder / name for name in sorted(names, key=lambda name: (name.count("/"), name))}
    for parent in dict.fromkeys(path.parent for path in paths.values()):
        parent.mkdir(parents=True, exist_ok=True)
    return paths
