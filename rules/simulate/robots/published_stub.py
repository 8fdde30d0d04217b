"""simulate.published without distributions: every folder contains a placeholder file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .published import FolderOptions

BACKEND = Backend(summary="no files but a licence", profiles=("stub",))


def files(ctx: Context, folder: FolderOptions, options: Options) -> dict[str, bytes]:
    """A licence file that names the folder."""
    return {"LICENSE": f"stand-in for {folder.distribution}: {folder.folder}\n".encode()}
