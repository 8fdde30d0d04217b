"""demonstrate.robomimic: episodes as the HDF5 file of robomimic."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any, Protocol

from pydantic import Field

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.episode import Episodes, Film
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.rule import Context, Tolerance, rule

from . import form

FILE = "demo.hdf5"
"""Name of the file."""


class RobomimicOptions(form.FormOptions):
    """Options of demonstrate.robomimic."""

    valid_share: float = Field(0.1, ge=0, lt=1)
    """Expected share of the starts to validate on; their episodes are filter key `valid`, the others `train`."""


class RobomimicBackend(Protocol):
    """Interface of a backend of demonstrate.robomimic."""

    def write(
        self,
        ctx: Context,
        bundle: TaskBundle,
        episodes: Episodes,
        film: Film | None,
        out: Path,
        common: RobomimicOptions,
        options: Any,
    ) -> None:
        """Write `FILE` below `out`, an empty folder."""
        ...


# Numbers in its file are rounded differently on another processor, and bytes have no difference to bound.
@rule(version=1, packages=("numpy",), tolerance=Tolerance({"files": math.inf}, metrics={"size": 0.1}))
def robomimic(
    ctx: Context[RobomimicBackend],
    bundle: TaskBundle,
    episodes: Episodes,
    film: Film | None = None,
    view: View | None = None,
    *,
    options: RobomimicOptions,
) -> Folder:
    """Return a folder with one HDF5 file for robomimic's loader.

    Actions are scaled from the limits of the task's actions to [-1, 1]; the limits are attributes of the group `data`.
    Episode i is `data/demo_i`; its attributes hold its start, so that it can be rerun.
    """
    form.check(ctx, episodes, film, view)
    out = Path(tempfile.mkdtemp(dir=ctx.scratch))
    ctx.backend.write(ctx, bundle, episodes, film, out, options, ctx.backend_options)
    folder, megabytes = form.folder(ctx, out)
    ctx.check(FILE in folder.files, "the file is missing")
    steps = sum(len(episode.joints) for episode in episodes.items.values())
    pictures = "with" if film else "without"
    ctx.say(f"{len(episodes.items)} demonstrations, {steps:,} steps {pictures} pictures, {megabytes:.1f} MB")
    return folder
