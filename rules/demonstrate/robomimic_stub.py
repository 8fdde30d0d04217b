"""demonstrate.robomimic without episodes: a file with HDF5's signature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

from . import robomimic_names

if TYPE_CHECKING:
    from .cameras import Camera
    from .robomimic import RobomimicOptions

BACKEND = Backend(summary="an empty file", profiles=("stub",))
SIGNATURE = b"\x89HDF\r\n\x1a\n"


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: RobomimicOptions,
    options: Options,
) -> None:
    """Write the signature."""
    trees.write({robomimic_names.FILE: SIGNATURE}, out)
