"""demonstrate.mcap without messages: the right number of files with the right names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.artifacts.core import trees
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .cameras import Camera
    from .mcap import McapOptions

BACKEND = Backend(summary="empty recordings", profiles=("stub",))
MAGIC = b"\x89MCAP0\r\n"


def write(
    ctx: Context,
    bundle: TaskBundle,
    episodes: Episodes,
    seen: Sequence[Camera],
    out: Path,
    common: McapOptions,
    options: Options,
) -> None:
    """Write the magic bytes at both ends of each recording."""
    trees.write({f"episode-{number:06d}.mcap": MAGIC + MAGIC for number in range(len(episodes.items))}, out)
